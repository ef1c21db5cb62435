#!/usr/bin/env bash
# Restarts X-Plane for `dtd generate --restart-simulator scripts/restart-x-plane.sh` on the same Linux computer (docs/x-plane.md): ends it in
# good order, waits until its process and its port are gone, and starts it in the background. After any other end, X-Plane 12 asks at the
# next start whether to start in safe mode.
#
#   X_PLANE           command line that starts it
#   X_PLANE_PID_FILE  file for its process' number; without it, the user's processes named X-Plane-x86_64 are meant
#   DTD_SIMULATOR     its address, set by dtd
#   QUIT_S, TERM_S, PORT_S  seconds that it gets to end by its own command, by a signal, and to free its port
set -u
usual='cd ~/"X-Plane 12" && exec ./X-Plane-x86_64 --window=1952x1312'
start=${X_PLANE:-$usual}
simulator=${DTD_SIMULATOR:-auto}
[[ $simulator == *:* ]] || simulator=127.0.0.1:49000
host=${simulator%:*} port=${simulator##*:}
if [[ $host != 127.* && $host != localhost ]] && ! grep -q -- "-- ${host//./\\.}$" /proc/net/fib_trie; then
    echo "$simulator is not on this computer: its restart command has to run there, for instance with ssh"
    exit 1
fi

# When a process began, in clock ticks since the computer did: another one with the same number began later.
began() {
    sed -n 's/.*) //p' "/proc/$1/stat" 2>/dev/null | cut -d' ' -f20
}

processes() {
    local process since
    if [[ -n ${X_PLANE_PID_FILE-} ]]; then
        read -r process since <"$X_PLANE_PID_FILE" || [[ -n ${process-} ]] || return
        [[ -n $since && $since != $(began "$process") ]] || echo "$process"
    else
        pgrep -u "$(id -u)" -x X-Plane-x86_64
    fi
} 2>/dev/null

# True if a process runs; one that has ended and was not waited for does not.
runs() {
    local process state
    for process in $(processes); do
        state=$(sed -n 's/^State:\s*//p' "/proc/$process/status" 2>/dev/null)
        [[ -n $state && $state != Z* ]] && return 0
    done
    return 1
}

port_is_held() {
    grep -q "^ *[0-9]*: [0-9A-F]*:$(printf %04X "$port") " /proc/net/udp
}

# Waits until a condition is false, for so many seconds at most.
until_not() {
    local tries=$(($2 * 5))
    while $1; do
        ((tries-- > 0)) || return 1
        sleep 0.2
    done
}

if runs; then
    printf 'CMND\0sim/operation/quit\0' >"/dev/udp/$host/$port"
    until_not runs "${QUIT_S:-60}" || { echo "X-Plane did not quit: SIGTERM"; kill -TERM $(processes); }
    until_not runs "${TERM_S:-30}" || { echo "X-Plane ignores SIGTERM: killed"; kill -KILL $(processes); }
fi
if ! until_not port_is_held "${PORT_S:-240}"; then
    echo "UDP port $port is still held: by another program, or by an X-Plane that has not ended"
    exit 1
fi
setsid bash -c "$start" </dev/null >/dev/null 2>&1 &
[[ -z ${X_PLANE_PID_FILE-} ]] || echo "$! $(began $!)" >"$X_PLANE_PID_FILE"
