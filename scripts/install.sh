#!/usr/bin/env bash
# Installs `dtd` with what it needs to run: the program, ONNX Runtime, manual pages and shell completions. Usage:
#
#   bash scripts/install.sh [PREFIX]      default: ~/.local
#
# Afterwards `dtd` works without this checkout. DTD=PROGRAM installs a program that is already built, with the ONNX Runtime beside it.
set -euo pipefail
cd "$(dirname "$0")/.."

prefix=${1:-$HOME/.local}
mkdir -p "$prefix"
prefix=$(cd "$prefix" && pwd)

program=${DTD:-}
if [ -z "$program" ]; then
    bash scripts/setup-build.sh
    cargo build --release --locked
    program=${CARGO_TARGET_DIR:-target}/release/dtd
fi
install -D "$program" "$prefix/bin/dtd"
# A copy: the environment in .venv may go away.
install -D -m 644 "$(dirname "$program")/../lib/dtd/libonnxruntime.so" "$prefix/lib/dtd/libonnxruntime.so"
"$prefix/bin/dtd" man "$prefix/share/man/man1"
completions() {
    mkdir -p "$(dirname "$prefix/share/$2")"
    "$prefix/bin/dtd" completions "$1" >"$prefix/share/$2"
}
completions bash bash-completion/completions/dtd
completions zsh zsh/site-functions/_dtd
completions fish fish/vendor_completions.d/dtd.fish

echo "installed $("$prefix/bin/dtd" --version) in $prefix/bin"
case ":$PATH:" in
    *":$prefix/bin:"*) ;;
    *) echo "add it to the PATH: export PATH=\"$prefix/bin:\$PATH\"" ;;
esac
