#!/usr/bin/env bash
# How fast `dtd view` is in Chromium, beside what Chromium itself needs for the same videos. Needs ffmpeg, Chromium and Playwright
# (scripts/setup.sh installs them).
#
# Usage: benches/view.sh [FOLDER]   (the measured corpus is made there, 2 GB, and used again; a temporary folder without FOLDER)
set -euo pipefail
folder=${1:+$(realpath -m "$1")}
cd "$(dirname "$0")/.."

exec cargo bench --locked --bench view -- ${folder:+"$folder"}
