#!/usr/bin/env bash
# lint_and_build.sh RUSTC ARGUMENTS...: a RUSTC_WRAPPER with which clippy compiles the workspace's crates, instead of checking all of them
# and their dependencies once more.
#
# Libraries are compiled by rustc, whose code is faster: clippy, which works on code that is not optimised yet, sees theirs with their unit
# tests. Tests, which only call libraries, are built without optimisation, in a quarter of the time. What others measure is not.
set -euo pipefail

case "${CARGO_PRIMARY_PACKAGE:+workspace} $*" in
workspace*" --crate-type lib "*) exec "$@" -D warnings ;;
workspace*"examples/"* | workspace*"benches/"*) exec clippy-driver "$@" -D warnings ;;
workspace*"src/lib.rs "* | workspace*"src/main.rs "*) exec clippy-driver "$@" -C opt-level=1 -D warnings ;;
workspace*) exec clippy-driver "$@" -C opt-level=0 -C debug-assertions=off -D warnings ;;
*) exec "$@" ;;
esac
