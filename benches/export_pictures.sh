#!/usr/bin/env bash
# `dtd export --to coco` against the ffmpeg program that extracts the same pictures as PNG. One run, rounds alternating, so that a busy
# machine is busy for both; prints the best of each, and the ratio of their pictures per second.
#
# Usage: benches/export_pictures.sh CORPUS [ROUNDS]   (a labelled corpus with two scenarios or more; the first two are exported)
# Needs the release build and ffmpeg. Writes nothing into CORPUS.
set -euo pipefail
cd "$(dirname "$0")/.."

corpus=$1
rounds=${2:-3}
dtd=${DTD:-target/release/dtd}
mapfile -t scenarios < <(ls "$corpus/scenarios" | head -2)
out=$(mktemp -d)
trap 'rm -rf "$out" "$out".*' EXIT

by_dtd() {
    "$dtd" export "$corpus" --to coco --out "$out/dtd" --only "$(IFS=,; echo "${scenarios[*]}")" >/dev/null 2>&1
}
# One process for each video and core at a time, as somebody in a hurry would run them.
by_ffmpeg() {
    for scenario in "${scenarios[@]}"; do
        for video in "$corpus/scenarios/$scenario"/views/*; do
            mkdir -p "$out/ffmpeg/$scenario-$(basename "$video")"
            printf '%s\0' "$video" "$out/ffmpeg/$scenario-$(basename "$video")/%06d.png"
        done
    done | xargs -0 -n 2 -P "$(nproc)" sh -c 'ffmpeg -nostdin -loglevel error -i "$0" -fps_mode passthrough "$1"'
}
seconds() {
    rm -rf "$out"/*
    local began=$EPOCHREALTIME
    "$1"
    awk -v a="$began" -v b="$EPOCHREALTIME" 'BEGIN { print b - a }'
}

for _ in $(seq "$rounds"); do
    seconds by_dtd >>"$out.dtd"
    seconds by_ffmpeg >>"$out.ffmpeg"
    pictures=$(find "$out/ffmpeg" -name '*.png' | wc -l)
done
paste "$out.dtd" "$out.ffmpeg" | awk -v n="$pictures" '
    NR == 1 || $1 < ours { ours = $1 }
    NR == 1 || $2 < theirs { theirs = $2 }
    END {
        printf "dtd export  %7.1f pictures/s\nffmpeg      %7.1f pictures/s\nratio       %7.2f\n", n / ours, n / theirs, theirs / ours
    }'
