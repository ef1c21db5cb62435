#!/usr/bin/env bash
# Makes an archive of `dtd` that runs without a compiler, and an archive with its debug symbols. Usage:
#
#   bash scripts/package.sh [--with-ffmpeg] [FOLDER]      default: target/packages
#
# dtd-VERSION-debian12-x86_64.tar.gz is for the distribution that this machine runs, and needs its FFmpeg. With --with-ffmpeg,
# dtd-VERSION-linux-x86_64.tar.gz contains FFmpeg's libraries and their dependencies, and needs only a C library (glibc) as new as this
# machine's. The symbols unpack to bin/dtd.debug, where debuggers find them. DTD=PROGRAM packs a program that is already built.
set -euo pipefail
cd "$(dirname "$0")/.."
umask 022

with_ffmpeg=
if [ "${1:-}" = --with-ffmpeg ]; then
    with_ffmpeg=linux
    shift
fi
mkdir -p "${1:-target/packages}"
packages=$(cd "${1:-target/packages}" && pwd)

program=${DTD:-}
if [ -z "$program" ]; then
    bash scripts/setup-build.sh ${with_ffmpeg:+patchelf}
    # The program's rpath (in its old form, which applies to libraries of libraries as well) leads to the libraries of --with-ffmpeg. Without
    # the prefix, messages of panics would name folders of this machine. Packed relocations make it smaller, and need glibc 2.36.
    # shellcheck disable=SC2016
    link='-Wl,--disable-new-dtags,-rpath,$ORIGIN/../lib/dtd,-z,pack-relative-relocs'
    RUSTFLAGS="--remap-path-prefix=${CARGO_HOME:-$HOME/.cargo}/registry/src=/crates" \
        cargo rustc --profile dist --locked --bin dtd -- -C "link-arg=$link"
    program=${CARGO_TARGET_DIR:-target}/dist/dtd
fi

# shellcheck source=/dev/null
distribution=$(. /etc/os-release && echo "$ID${VERSION_ID:-}")
version=$("$program" --version | cut -d ' ' -f 2)
name=dtd-$version-${with_ffmpeg:-$distribution}-$(uname -m)
staging=$(mktemp -d)
trap 'rm -rf "$staging"' EXIT
root=$staging/$name
symbols=$staging/symbols/$name/bin
licences=$root/share/doc/dtd
mkdir -p "$symbols" "$licences/onnxruntime"

DTD=$program bash scripts/install.sh "$root" >/dev/null
objcopy --only-keep-debug "$root/bin/dtd" "$symbols/dtd.debug"
(cd "$symbols" && objcopy --strip-all --add-gnu-debuglink=dtd.debug "$root/bin/dtd")

cp LICENSE-MIT LICENSE-APACHE "$licences"
python3 scripts/crate_licences.py >"$licences/crates.txt"
onnxruntime=$(dirname "$(dirname "$(realpath "$(dirname "$program")/../lib/dtd/libonnxruntime.so")")")
cp "$onnxruntime/LICENSE" "$onnxruntime/ThirdPartyNotices.txt" "$licences/onnxruntime"
cat >"$root/README.md" <<END
# dtd $version

\`bin/dtd demo --out demo\` runs the whole pipeline at small scale; \`bin/dtd --help\` and \`man -M share/man dtd\` describe the commands. The
folder can be moved; \`bin\` and \`lib\` stay beside each other.

## Licences

Their texts are in \`share/doc/dtd\`.

| part | licence |
|---|---|
| \`dtd\` | MIT (\`LICENSE-MIT\`) or Apache-2.0 (\`LICENSE-APACHE\`) |
| crates that it contains | as listed in \`crates.txt\` |
| Rust's standard library | MIT or Apache-2.0 |
| ONNX Runtime, \`lib/dtd/libonnxruntime.so\` | MIT, and the licences of its parts (\`onnxruntime/\`) |
END

if [ -n "$with_ffmpeg" ]; then
    mkdir "$licences/debian"
    # `dtd` loads libavdevice, the drivers of cameras and screens, only when it needs them: `ldd` does not list it. It is beside libavformat.
    drivers=$(ldd "$program" | awk '$1 ~ /^libavformat/ { sub("avformat", "avdevice", $3); print $3 }')
    {
        ldd "$program" "$drivers" | awk '$2 == "=>" { print $1, $3 }'
        echo "$(basename "$drivers") $drivers"
    } | sort -u | while read -r soname path; do
        file=$(realpath "$path")
        # Packages from before Debian merged /lib into /usr/lib list their files without /usr.
        package=$(dpkg-query -S "$file" 2>/dev/null || dpkg-query -S "${file#/usr}")
        package=${package%%:*}
        [ "$package" != libc6 ] || continue
        cp "$file" "$root/lib/dtd/$soname"
        cp -L "/usr/share/doc/$package/copyright" "$licences/debian/$package"
        # A search path of its own would replace the program's.
        if readelf -d "$file" | grep -q RUNPATH; then
            # shellcheck disable=SC2016
            patchelf --set-rpath '$ORIGIN' "$root/lib/dtd/$soname"
        fi
    done
    cp -rL /usr/share/common-licenses "$licences"
    # shellcheck disable=SC2016
    (cd "$licences/debian" && dpkg-query -W -f '${source:Package}=${source:Version}\n' -- *) | sort -u >"$licences/sources.txt"
    cat >>"$root/README.md" <<END
| FFmpeg and the libraries that it needs, \`lib/dtd\` | as listed in \`debian/\` by package, with texts in \`common-licenses/\` |

FFmpeg's libraries and their dependencies are copies of packages of $distribution, unmodified but for search paths. FFmpeg was built with
its parts under the GPL and loads x264 and x265 (GPL, version 2 or later) and libcdio (GPL, version 3 or later), so the archive as a whole is
distributed under the GPL; each part keeps its own licence. \`sources.txt\` names Debian's source packages: \`apt-get source NAME=VERSION\`
fetches one, and Debian's archive of snapshots keeps replaced versions.
END
    glibc='^(ld-linux.*|lib(c|m|mvec|dl|pthread|rt|resolv|util|anl))\.so'
    # With the drivers loaded first, their libraries have the program's search path, as they do when it loads them.
    loaded=$(env -i LD_PRELOAD="$root/lib/dtd/$(basename "$drivers")" ldd "$root/bin/dtd")
    if outside=$(awk '$2 == "=>"' <<<"$loaded" | grep -vF "$root/" | awk '{ print $1 }' | grep -vE "$glibc"); then
        echo "package: $program would load libraries from outside the archive, expected the rpath \$ORIGIN/../lib/dtd:" >&2
        echo "$outside" >&2
        exit 1
    fi
fi

pack() {
    tar --create --sort=name --owner=0 --group=0 --numeric-owner --directory "$1" "$name" | gzip -n >"$packages/$2.tar.gz"
    echo "$packages/$2.tar.gz"
}
pack "$staging" "$name"
pack "$staging/symbols" "$name-symbols"
