#!/usr/bin/env bash
# lint_and_build.sh RUSTC ARGUMENTS...: a RUSTC_WRAPPER that runs clippy on the workspace's crates before they are compiled.
#
# `cargo clippy` checks all dependencies a second time. Lints need only their metadata, and during a build that is there.
set -euo pipefail

if [ -n "${CARGO_PRIMARY_PACKAGE:-}" ]; then
    folder=$(mktemp -d)
    trap 'rm -rf "$folder"' EXIT
    arguments=()
    previous=
    for argument in "$@"; do
        case $argument in
        --emit=*) argument=--emit=metadata ;;
        # Without `artifacts`: cargo takes their announcement for the build's own.
        --json=*) argument=--json=diagnostic-rendered-ansi ;;
        esac
        if [ "$previous" = --out-dir ]; then argument=$folder; fi
        arguments+=("$argument")
        previous=$argument
    done
    clippy-driver "${arguments[@]}" -D warnings
fi
"$@"
