#!/usr/bin/env bash
# Installs what the tests need and this machine lacks, after scripts/setup-build.sh, which installs what building needs.
#
# Installs: Xvfb (an X server without a screen, for the tests of screen capture), the programs b3sum, ffmpeg, strace and chromium,
# Debian's torch, and four Python environments: .venv (requirements.txt), .venv-torch with what needs torch, .venv-clients with other
# authors' X-Plane clients, and .venv-openvino with another build of ONNX Runtime.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { printf 'setup: %s\n' "$*" >&2; }

packages=(
    xvfb
    # Independent tools that tests and benches compare our files with.
    b3sum ffmpeg
    # Which addresses a verb tries (tests/no_connections.rs).
    strace
    # A browser, for the page of `dtd view` (tests/view.rs).
    chromium
    # Loads the Dataset of python/ (requirements-torch.txt).
    python3-torch
    # A server of camera streams (tests/judges/rtsp_server.py).
    gir1.2-gst-rtsp-server-1.0 gstreamer1.0-plugins-good python3-gi
)
bash scripts/setup-build.sh "${packages[@]}"

# Python compiles a module when it is first imported; most never are.
export PIP_NO_COMPILE=1

stamp=.venv/requirements.installed
if ! cat scripts/requirements.txt scripts/requirements-alone.txt | cmp -s - "$stamp"; then
    say "installing Python packages into .venv"
    .venv/bin/python -m pip install --quiet --disable-pip-version-check -r scripts/requirements.txt >&2
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r scripts/requirements-alone.txt >&2
    cat scripts/requirements.txt scripts/requirements-alone.txt >"$stamp"
fi

stamp=.venv-torch/requirements.installed
if ! cmp -s scripts/requirements-torch.txt "$stamp"; then
    say "installing Python packages into .venv-torch"
    rm -rf .venv-torch
    # The Python for which Debian built its torch, whichever is first on the PATH.
    /usr/bin/python3 -m venv --system-site-packages .venv-torch
    .venv-torch/bin/python -m pip install --quiet --disable-pip-version-check -r scripts/requirements-torch.txt >&2
    cp scripts/requirements-torch.txt "$stamp"
fi

stamp=.venv-openvino/requirements.installed
if ! cmp -s scripts/requirements-openvino.txt "$stamp"; then
    say "unpacking ONNX Runtime with OpenVINO into .venv-openvino"
    rm -rf .venv-openvino
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --target .venv-openvino \
        -r scripts/requirements-openvino.txt >&2
    # Where there is no wheel for this machine or its Python, nothing was unpacked, and the test is skipped.
    mkdir -p .venv-openvino
    cp scripts/requirements-openvino.txt "$stamp"
fi

# Other authors' X-Plane clients, for testing the stand-in. Some need Python 3.12: the newest installed one is used, and
# clients that it is too old for are excluded by requirements-clients.txt and skipped by the tests.
if ! cmp -s scripts/requirements-clients.txt .venv-clients/requirements.installed; then
    newest=python3
    for candidate in python3.12 python3.13 "$HOME"/.pyenv/versions/3.1[2-9]*/bin/python3; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 12))' 2>/dev/null; then
            newest=$candidate
            break
        fi
    done
    say "installing X-Plane clients into .venv-clients ($("$newest" --version))"
    rm -rf .venv-clients
    "$newest" -m venv .venv-clients
    .venv-clients/bin/python -m pip install --quiet --disable-pip-version-check -r scripts/requirements-clients.txt >&2
    cp scripts/requirements-clients.txt .venv-clients/requirements.installed
fi
