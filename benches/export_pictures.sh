#!/usr/bin/env bash
# `dtd export` against the ffmpeg program on the same videos: for coco, pictures as PNG; for formats that keep videos, a copy of their
# packets (`-c copy`). One run, rounds alternating, so that a busy machine is busy for both; prints the best of each, and the ratio of their
# pictures per second. `dtd` also checks every file against its seal, and hashes what it writes.
#
# Usage: benches/export_pictures.sh CORPUS [ROUNDS [coco|mcap|huggingface]]
#     (a labelled corpus with two scenarios or more; the first two are exported)
# Needs the release build and ffmpeg. Writes nothing into CORPUS.
set -euo pipefail
cd "$(dirname "$0")/.."

corpus=$1
rounds=${2:-3}
format=${3:-coco}
dtd=${DTD:-target/release/dtd}
mapfile -t scenarios < <(ls "$corpus/scenarios" | head -2)
out=$(mktemp -d)
trap 'rm -rf "$out" "$out".*' EXIT

by_dtd() {
    "$dtd" export "$corpus" --to "$format" --out "$out/dtd" --json --only "$(IFS=,; echo "${scenarios[*]}")" 2>/dev/null >"$out.counts"
}
case $format in
    coco) written='%06d.png' ;;
    *) written='copy.mp4' ;;
esac
# One process for each video and core at a time, as somebody in a hurry would run them.
by_ffmpeg() {
    for scenario in "${scenarios[@]}"; do
        for video in "$corpus/scenarios/$scenario"/views/*; do
            mkdir -p "$out/ffmpeg/$scenario-$(basename "$video")"
            printf '%s\0' "$video" "$out/ffmpeg/$scenario-$(basename "$video")/$written"
        done
    done | xargs -0 -n 2 -P "$(nproc)" sh -c \
        'case $1 in *.png) how="-fps_mode passthrough" ;; *) how="-c copy" ;; esac
         ffmpeg -nostdin -loglevel error -i "$0" $how "$1"'
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
done
pictures=$(sed -n 's/.*"pictures": *\([0-9]*\).*/\1/p' "$out.counts")
paste "$out.dtd" "$out.ffmpeg" | awk -v n="$pictures" '
    NR == 1 || $1 < ours { ours = $1 }
    NR == 1 || $2 < theirs { theirs = $2 }
    END {
        printf "dtd export  %7.1f images/s\nffmpeg      %7.1f images/s\nratio       %7.2f\n", n / ours, n / theirs, theirs / ours
    }'
