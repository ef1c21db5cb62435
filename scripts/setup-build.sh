#!/usr/bin/env bash
# Installs what building and running `dtd` needs and this machine lacks. Safe to run again; the second time it only checks.
#
# Needs: Debian 12 (or a relative with apt), a Rust toolchain, Python 3, and root or sudo if packages are missing.
# Installs: a C compiler, the development packages of FFmpeg, and ONNX Runtime, a shared library from a Python package, in .venv.
# scripts/setup.sh adds what the tests need. Arguments: further Debian packages.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { printf 'setup: %s\n' "$*" >&2; }

command -v cargo >/dev/null || {
    say "cargo is not on the PATH. Install a Rust toolchain (1.95 or newer) and run this again."
    exit 1
}

packages=(
    build-essential pkg-config libclang-dev python3-venv
    libavutil-dev libavcodec-dev libavformat-dev libavfilter-dev libavdevice-dev libswscale-dev libswresample-dev
    "$@"
)
missing=()
for package in "${packages[@]}"; do
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing+=("$package")
done
if ((${#missing[@]})); then
    command -v apt-get >/dev/null || {
        say "there is no apt-get here. Install the equivalents of ${missing[*]} yourself, and run cargo build --release --locked."
        exit 1
    }
    as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || {
            say "these packages are missing and there is no sudo: ${missing[*]}. Install them as root and run this again."
            exit 1
        }
        as_root=(sudo)
    fi
    say "installing ${missing[*]}"
    "${as_root[@]}" apt-get -o DPkg::Lock::Timeout=300 -qq update >&2
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get -o DPkg::Lock::Timeout=300 -qq install -y --no-install-recommends "${missing[@]}" >&2
fi

# The library is all that `dtd` uses of the package, so it needs none of its dependencies.
requirements=scripts/requirements-onnxruntime.txt
version=$(sed -n 's/^onnxruntime==\([0-9.]*\).*/\1/p' "$requirements")
library() { find "$PWD/.venv/lib" -name "libonnxruntime.so.$version" -print -quit 2>/dev/null || true; }
if [ -z "$(library)" ]; then
    say "installing ONNX Runtime $version into .venv"
    python3 -m venv .venv
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r "$requirements" >&2
fi

# Where `target/release/dtd` looks for ONNX Runtime: ../lib/dtd relative to the program's folder.
lib=${CARGO_TARGET_DIR:-target}/lib/dtd
mkdir -p "$lib"
ln -sfn "$(library)" "$lib/libonnxruntime.so"
