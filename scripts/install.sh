#!/usr/bin/env bash
# Installs `dtd` with all that it needs to run: the program, ONNX Runtime, manual pages and bash completions. Usage:
#
#   bash scripts/install.sh [PREFIX]      default: ~/.local
#
# Needs what scripts/setup.sh installs for building (its Python environment provides ONNX Runtime), and runs it. Afterwards `dtd` works
# without this checkout.
set -euo pipefail
cd "$(dirname "$0")/.."

prefix=${1:-$HOME/.local}
mkdir -p "$prefix"
prefix=$(cd "$prefix" && pwd)

bash scripts/setup.sh
cargo install --path . --locked --force --no-track --root "$prefix"
mkdir -p "$prefix/lib/dtd"
# A copy: the environment in .venv may go away.
cp -L "${CARGO_TARGET_DIR:-target}/lib/dtd/libonnxruntime.so" "$prefix/lib/dtd/libonnxruntime.so.new"
mv "$prefix/lib/dtd/libonnxruntime.so.new" "$prefix/lib/dtd/libonnxruntime.so"
"$prefix/bin/dtd" man "$prefix/share/man/man1"
completions="$prefix/share/bash-completion/completions"
mkdir -p "$completions"
"$prefix/bin/dtd" completions bash >"$completions/dtd"

echo "installed $("$prefix/bin/dtd" --version) in $prefix/bin"
case ":$PATH:" in
    *":$prefix/bin:"*) ;;
    *) echo "add it to the PATH: export PATH=\"$prefix/bin:\$PATH\"" ;;
esac
