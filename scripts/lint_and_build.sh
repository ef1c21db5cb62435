#!/usr/bin/env bash
# lint_and_build.sh RUSTC ARGUMENTS...: a RUSTC_WRAPPER with which clippy compiles the workspace's crates, instead of checking all of them
# and their dependencies once more.
#
# Libraries are compiled by rustc, whose code is faster: clippy, which works on code that is not optimised yet, sees theirs with their tests.
set -euo pipefail

case "${CARGO_PRIMARY_PACKAGE:+workspace} $*" in
workspace*" --crate-type lib "*) exec "$@" -D warnings ;;
workspace*) exec clippy-driver "$@" -D warnings ;;
*) exec "$@" ;;
esac
