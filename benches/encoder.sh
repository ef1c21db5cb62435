#!/usr/bin/env bash
# Our encoder against the ffmpeg program on the same raw pictures and settings, alternating in one run; fails below 0.95 of its rate.
# Needs the ffmpeg program (scripts/setup.sh installs it). The outcome is written down in docs/video.md.
set -euo pipefail
cd "$(dirname "$0")/.."

exec cargo bench --locked --bench encoder
