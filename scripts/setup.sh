#!/usr/bin/env bash
# Installs what the project needs and this machine lacks. Safe to run again; the second time it only looks.
#
# Needs: Debian 12 (or a relative with apt), a Rust toolchain, Python 3, and root or sudo if packages are missing.
# Installs: the development packages of FFmpeg, and a virtual environment in .venv with ONNX Runtime (see requirements.txt).
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
)
missing=()
for package in "${packages[@]}"; do
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing+=("$package")
done
if ((${#missing[@]})); then
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

stamp=.venv/requirements.installed
if ! cmp -s scripts/requirements.txt "$stamp"; then
    say "installing Python packages into .venv"
    python3 -m venv .venv
    .venv/bin/python -m pip install --quiet --disable-pip-version-check -r scripts/requirements.txt >&2
    cp scripts/requirements.txt "$stamp"
fi
