#!/usr/bin/env bash
# Checks all dependencies against deny.toml (licences, sources, bans), and against RustSec's database of known vulnerabilities, which
# `cargo audit` uses as well: one tool for both.
#
# Uses the cargo-deny that scripts/setup.sh installs, and builds one where there is none, which takes minutes. The database is a git
# repository on GitHub: if that cannot be reached, this says so and checks the rest; DTD_ADVISORIES=must makes it a failure.
set -euo pipefail
cd "$(dirname "$0")/.."

version=0.20.2
PATH=$PWD/.venv/bin:$PATH
database=https://github.com/RustSec/advisory-db

if [ "$(cargo deny --version 2>/dev/null)" != "cargo-deny $version" ]; then
    CARGO_PROFILE_DEV_DEBUG=0 cargo install --quiet --debug --locked "cargo-deny@$version"
fi

failed=0
cargo deny --locked check licenses bans sources || failed=1

if GIT_TERMINAL_PROMPT=0 timeout 20 git ls-remote --exit-code "$database" HEAD >/dev/null 2>&1; then
    cargo deny --locked check advisories || failed=1
else
    echo "supply-chain: ADVISORIES WERE NOT CHECKED: $database cannot be reached from here" >&2
    [ "${DTD_ADVISORIES:-}" != must ] || failed=1
fi
exit $failed
