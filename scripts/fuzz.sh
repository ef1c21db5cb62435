#!/usr/bin/env bash
# Fuzzes the decoders of untrusted bytes: scripts/fuzz.sh [TARGET|all] [SECONDS], `packets` and 600 by default, on one core. Ends with the
# number of executions, or with the input that broke the target.
#
# Starts from valid files: the repository's own, and those of the labelled and detected corpus that DTD_FUZZ_CORPUS names (one is made in
# seconds: `dtd generate tests/data/small.toml --out C && dtd label C && dtd detect C`). The found inputs stay in fuzz/corpus.
#
# Installs cargo-fuzz if it is missing. Needs a C++ compiler (libFuzzer), no nightly toolchain: address sanitizing, which would need one, finds
# nothing in code that forbids unsafe. scripts/sanitize.sh is for the files that have some.
set -euo pipefail
cd "$(dirname "$0")/.."

all=(answers link packets recording records sweep tables tape)
target=${1:-packets}
seconds=${2:-600}
if [ "$target" = all ]; then
    for target in "${all[@]}"; do bash "$0" "$target" "$seconds"; done
    exit
fi

seeds=fuzz/corpus/$target
mkdir -p "$seeds"
scenario=
if [ -n "${DTD_FUZZ_CORPUS:-}" ]; then
    scenario=$(find "$DTD_FUZZ_CORPUS/scenarios" -mindepth 1 -maxdepth 1 -type d ! -name '*.partial' | sort | head -n 1)
fi

# Copies of files as seeds, prefixed with the byte for their kind.
seed() {
    local kind=$1 file
    shift
    for file in "$@"; do
        { printf "$kind" && cat "$file"; } >"$seeds/seed-$kind-$(basename "$file")"
    done
}
need_corpus() {
    [ -n "$scenario" ] || echo "fuzz: $target has few seeds without DTD_FUZZ_CORPUS, see the head of scripts/fuzz.sh" >&2
}

# Prints a number ($1) as $2 bytes, little-endian.
bytes_of() {
    local shift
    for ((shift = 0; shift < 8 * $2; shift += 8)); do printf "\\x$(printf %02x $(($1 >> shift & 255)))"; done
}

longest=65536
case $target in
answers) longest=4096 ;;
link)
    longest=4096
    for direction in '\000' '\001' '\002' '\003'; do seed "$direction" xplane-bridge/golden/link_*.bin; done
    ;;
packets)
    longest=2048
    seed '' xplane-bridge/golden/*.bin
    ;;
recording)
    longest=16384
    for file in tests/data/flights/*.csv; do
        head -n 40 "$file" >"$seeds/seed-$(basename "$file")"
    done
    ;;
records)
    need_corpus
    if [ -n "$scenario" ]; then
        seed '\000' "$DTD_FUZZ_CORPUS/plan.json"
        seed '\001' "$DTD_FUZZ_CORPUS/splits.json"
        seed '\002' "$scenario/scenario.json"
        seed '\003' "$scenario/calibration.json"
        seed '\004' "$scenario"/detections/*.json
        seed '\005' "$scenario/DONE.json"
        seed '\006' "$scenario/MANIFEST.b3"
    fi
    ;;
sweep)
    longest=16384
    # Recordings would have to lie where the target looks for them.
    for file in ./*.toml tests/data/*.toml; do
        sed '/^\[\[recorded\]\]/,/^$/d' "$file" >"$seeds/seed-$(basename "$file")"
    done
    ;;
tables)
    need_corpus
    if [ -n "$scenario" ]; then
        seed '\000' "$scenario/frames.parquet"
        seed '\001' "$scenario/boxes_truth.parquet"
        seed '\002' "$scenario"/detections/*.parquet
        seed '\003' "$scenario"/registrations/*.parquet
        seed '\004' "$scenario"/health/*.parquet
        seed '\005' "$scenario"/backgrounds/*.parquet
        if [ -f "$scenario/aircraft.parquet" ]; then seed '\006' "$scenario/aircraft.parquet"; fi
    fi
    ;;
tape)
    seed '\000' tests/data/tape/session.mcap
    # The records of a chunk: a channel of the link, and a message on it.
    topic=/link/1/from_simulator encoding=dtd-link
    for file in xplane-bridge/golden/link_*.bin; do
        {
            printf '\001\x04' && bytes_of $((2 + 2 + 4 + ${#topic} + 4 + ${#encoding} + 4)) 8
            bytes_of 1 2 && bytes_of 0 2
            bytes_of ${#topic} 4 && printf %s $topic
            bytes_of ${#encoding} 4 && printf %s $encoding
            bytes_of 0 4
            printf '\x05' && bytes_of $((2 + 4 + 8 + 8 + $(wc -c <"$file"))) 8
            bytes_of 1 2 && bytes_of 0 4 && bytes_of 0 8 && bytes_of 0 8
            cat "$file"
        } >"$seeds/seed-chunk-$(basename "$file")"
    done
    ;;
*)
    echo "fuzz: there is no target $target; expected one of ${all[*]}, or all" >&2
    exit 2
    ;;
esac

command -v cargo-fuzz >/dev/null || cargo install --locked cargo-fuzz@0.13.2
exec cargo fuzz run --sanitizer none "$target" -- -max_total_time="$seconds" -max_len="$longest" -timeout=60 -rss_limit_mb=2048 -print_final_stats=1
