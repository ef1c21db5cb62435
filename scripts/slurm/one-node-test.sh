#!/usr/bin/env bash
# Installs Slurm on this machine (Debian 12, root), starts it with one node, records a small corpus with a real job array, one task of which is
# stopped by Slurm in the middle and requeued, and compares the corpus byte by byte with that of a single run. Opt-in: not part of test.sh.
set -euo pipefail
cd "$(dirname "$0")/../.."

sweep=$PWD/${1:-tests/data/small.toml}
tasks=${TASKS:-3}
export DTD=${DTD:-$PWD/target/release/dtd}
[ -x "$DTD" ] || cargo build --release --locked
[ "$(id -u)" -eq 0 ] || { echo "one-node-test: needs root" >&2; exit 1; }

if ! command -v slurmctld >/dev/null || ! command -v slurmd >/dev/null || ! command -v munged >/dev/null; then
    apt-get -o DPkg::Lock::Timeout=300 -qq update >&2
    DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=300 -qq install -y --no-install-recommends slurm-wlm munge >&2
fi

work=$(mktemp -d /tmp/dtd-slurm.XXXXXX)
host=$(hostname -s)
cores=$(nproc)
pids=()
cleanup() {
    for pid in "${pids[@]}"; do kill "$pid" 2>/dev/null || true; done
    wait 2>/dev/null || true
    rm -rf "$work"
}
trap cleanup EXIT

# munge: its key comes with the package. A separate socket avoids a munged that may run already.
mkdir -p "$work/munge" "$work/state" "$work/spool"
dd if=/dev/urandom of="$work/munge/key" bs=1024 count=1 status=none
chmod 0700 "$work/munge" && chmod 0400 "$work/munge/key"
munged --foreground --force --key-file="$work/munge/key" --socket="$work/munge/socket" \
    --pid-file="$work/munge/pid" --log-file="$work/munge/log" --seed-file="$work/munge/seed" >/dev/null 2>&1 &
pids+=($!)

cat >"$work/slurm.conf" <<CONF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=26817
SlurmdPort=26818
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$work/munge/socket
CryptoType=crypto/munge
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SwitchType=switch/none
MpiDefault=none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
RequeueExit=75
KillWait=30
MinJobAge=3600
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores State=UNKNOWN
PartitionName=main Nodes=$host Default=YES MaxTime=INFINITE State=UP OverSubscribe=FORCE:8
CONF
export SLURM_CONF=$work/slurm.conf
slurmctld -D >/dev/null 2>&1 &
pids+=($!)
slurmd -D -N "$host" >/dev/null 2>&1 &
pids+=($!)
for _ in $(seq 60); do
    sinfo -h -o %T 2>/dev/null | grep -qE 'idle|mixed' && break
    sleep 1
done
sinfo -h -o %T | grep -qE 'idle|mixed' || { echo "one-node-test: the node did not come up" >&2; tail -n 20 "$work"/*.log >&2; exit 1; }

job=$(sbatch --parsable --array="1-$tasks" --cpus-per-task=1 --mem=0 --output="$work/task-%a.log" --open-mode=append \
    --export="ALL,SWEEP=$sweep,CORPUS=$work/corpus" scripts/slurm/generate.sbatch)
echo "one-node-test: job $job, $tasks tasks"
# One task is stopped in the middle, as at the end of its time: exit code 75, and Slurm restarts it.
until compgen -G "$work/corpus/scenarios/*.partial" >/dev/null; do sleep 0.05; done
scancel --signal=TERM --full "${job}_1"
for _ in $(seq 600); do
    # Requeued tasks wait two minutes before they are started again, unless they are told not to.
    for held in $(squeue -h -j "$job" -t PENDING -o %i 2>/dev/null); do
        scontrol update "jobid=$held" starttime=now 2>/dev/null || true
        scontrol release "$held" 2>/dev/null || true
    done
    squeue -h -j "$job" -t PENDING,RUNNING,COMPLETING 2>/dev/null | grep -q . || break
    sleep 1
done
scontrol show job "$job" | grep -oE '(ArrayTaskId|JobState|Restarts|ExitCode)=[^ ]+' | paste -sd ' ' >&2
completed=$(scontrol show job "$job" | grep -c 'JobState=COMPLETED' || true)
((completed == tasks)) || { echo "one-node-test: $completed of $tasks tasks completed" >&2; tail -n 5 "$work"/task-*.log >&2; exit 1; }
restarts=$(scontrol show job "$job" | grep -oE 'Restarts=[0-9]+' | cut -d = -f 2 | awk '{ sum += $1 } END { print sum }')

"$DTD" generate "$sweep" --out "$work/whole" --shard 0/1 >/dev/null 2>&1
for corpus in whole corpus; do
    (cd "$work/$corpus" && find . -type f -exec sha256sum {} + | sort -k 2) >"$work/$corpus.sha256"
done
diff "$work/whole.sha256" "$work/corpus.sha256" || { echo "one-node-test: the corpora differ" >&2; tail -n 5 "$work"/task-*.log >&2; exit 1; }
echo "one-node-test: $(sinfo --version), $tasks tasks at once, $restarts requeued after SIGTERM: $(wc -l <"$work/whole.sha256") files byte-identical to one run"
