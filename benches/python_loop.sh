#!/usr/bin/env bash
# `dtd detect` against a plain Python loop (OpenCV, ONNX Runtime, NumPy) with the same model, videos and windows, and against SAHI's
# slicing. One run, rounds alternating, so that a busy machine is busy for all; prints a table of the best of each and their ratios.
#
# Usage: [ROUNDS=3] [DTD_OPTIONS="--device openvino .."] benches/python_loop.sh CORPUS [MODEL.onnx]
# CORPUS must be labelled; a model must have rows of `[batch, candidates, 6]`, and is the one that ships by default. DTD_OPTIONS are for
# `dtd detect` alone.
# Needs the release build and scripts/setup.sh. Installs Python packages into target/python-loop. Writes nothing into CORPUS.
set -euo pipefail
cd "$(dirname "$0")/.."

requirements=benches/python_loop/requirements.txt
venv=target/python-loop
if ! cmp -s "$requirements" "$venv/installed"; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check -r "$requirements" >&2
    "$venv/bin/pip" install --quiet --disable-pip-version-check --no-deps sahi==0.12.8 >&2
    cp "$requirements" "$venv/installed"
fi
exec "$venv/bin/python" benches/python_loop/compare.py "${DTD:-target/release/dtd}" "$@"
