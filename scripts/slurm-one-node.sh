#!/usr/bin/env bash
# Proves a campaign's job array on a real Slurm of one node: submits the scripts that `needle campaign --slurm` writes, kills and
# requeues a task that is at work, and compares the merged result with that of this machine alone, byte for byte.
#
# usage: slurm-one-node.sh PROGRAM [FOLDER]     PROGRAM is the built `needle`; FOLDER is kept where given
# Needs slurmctld, slurmd, slurm-client and munge (Debian's packages) and root; exits with 77 where they are missing.
set -euo pipefail

skip() { echo "skipped: $1" >&2; exit 77; }
needle=$(readlink -f "${1:?usage: slurm-one-node.sh PROGRAM [FOLDER]}")
for program in munged slurmctld slurmd sbatch scontrol squeue; do
    PATH=$PATH:/usr/sbin command -v "$program" >/dev/null || skip "no $program"
done
[ "$(id -u)" = 0 ] || skip "slurmd needs root"
PATH=$PATH:/usr/sbin
# A Slurm that is at work here is none of ours to disturb.
if pgrep -x slurmctld >/dev/null || pgrep -x munged >/dev/null; then skip "Slurm or munge runs here already"; fi

scratch=${2:-$(mktemp -d /tmp/slurm-one-node.XXXXXX)}
mkdir -p "$scratch"
chmod 755 "$scratch"
name=$(hostname -s)
export SLURM_CONF=$scratch/slurm.conf

stop() {
    for pid in slurmd slurmctld munged; do
        [ -s "$scratch/$pid.pid" ] && kill "$(cat "$scratch/$pid.pid")" 2>/dev/null || true
    done
    sleep 1
    [ -n "${keep:-}" ] || rm -rf "$scratch"
}
keep=${2:-}
trap stop EXIT

# munge insists on a key and a socket that nobody else can change.
user=$(id -u munge >/dev/null 2>&1 && echo munge || echo root)
install -d -m 755 -o "$user" "$scratch/munge"
dd if=/dev/urandom of="$scratch/munge/key" bs=1024 count=1 status=none
chown "$user" "$scratch/munge/key"
chmod 400 "$scratch/munge/key"
munged=(munged --key-file="$scratch/munge/key" --socket="$scratch/munge/socket" --pid-file="$scratch/munge/munged.pid"
    --log-file="$scratch/munge/log" --seed-file="$scratch/munge/seed" --force)
if [ "$user" = root ]; then "${munged[@]}"; else setpriv --reuid "$user" --clear-groups "${munged[@]}"; fi
ln -sf munge/munged.pid "$scratch/munged.pid"

mkdir -p "$scratch/state" "$scratch/spool"
cat > "$SLURM_CONF" <<CONF
ClusterName=one
SlurmctldHost=$name(127.0.0.1)
AuthType=auth/munge
AuthInfo=socket=$scratch/munge/socket
CredType=cred/munge
SlurmUser=root
SlurmctldPort=26817
SlurmdPort=26818
SlurmctldPidFile=$scratch/slurmctld.pid
SlurmdPidFile=$scratch/slurmd.pid
SlurmctldLogFile=$scratch/slurmctld.log
SlurmdLogFile=$scratch/slurmd.log
StateSaveLocation=$scratch/state
SlurmdSpoolDir=$scratch/spool
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SchedulerType=sched/backfill
ReturnToService=2
MpiDefault=none
NodeName=$name NodeAddr=127.0.0.1 CPUs=$(nproc)
PartitionName=one Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
slurmctld
slurmd
await() { # seconds, what, command
    for _ in $(seq $((10 * $1))); do
        if eval "$3"; then return; fi
        sleep 0.1
    done
    echo "waited $1 s for $2" >&2
    squeue >&2 || true
    tail -20 "$scratch"/*.log "$scratch"/results/*.log >&2 2>/dev/null || true
    exit 1
}
await 30 "an idle node" '[ "$(sinfo --noheader --format=%T 2>/dev/null)" = idle ]'

# A campaign whose tasks take long enough to be killed in the middle.
cat > "$scratch/scenario.toml" <<SCENARIO
[needle]
curvature_per_mm = 0.006
[reference]
kind = "inputs"
curvature_factor = 0.5
segments = [{ duration_s = 20.0, v_mm_s = 5.0, omega_rad_s = 0.05 }]
[controller]
name = "sliding_mode"
[plant]
substeps = 100
[plant.disturbances]
heading_std_rad_per_sqrt_mm = 0.001
SCENARIO
cat > "$scratch/campaign.toml" <<CAMPAIGN
scenario = "scenario.toml"
seed = 5
runs_per_cell = 400
chunk_runs = 5
track_every = 10
[grid]
controller.name = ["sliding_mode", "feed_forward"]
[random]
plant.curvature_factor = { distribution = "uniform", from = 0.8, to = 1.2 }
CAMPAIGN
cd "$scratch"
"$needle" campaign campaign.toml --out alone >/dev/null

"$needle" campaign campaign.toml --out results --slurm --tasks 4
bash results/submit.sh | tee submitted
array=$(sed 's/array \([0-9]*\),.*/\1/' submitted)

parts() { ls results/parts 2>/dev/null | grep -c '^part-' || true; }
await 60 "the first chunks" '[ "$(parts)" -ge 5 ]'
task=$(squeue --noheader --states=running --format=%i --jobs="$array" --array | head -1)
before=$(parts)
# Slurm kills the task's processes and puts it back into the queue.
scontrol requeue "$task"
await 20 "the killed task in the queue" '[ -n "$(squeue --noheader --jobs="$array" --array --format=%i)" ]'
echo "task $task killed and requeued with $before of 160 chunks done"
# Slurm lets a requeued task wait for two minutes; nobody else needs the time here.
for _ in $(seq 300); do
    scontrol update jobid="$task" StartTime=now 2>/dev/null || true
    scontrol release "$task" 2>/dev/null || true
    [ -s results/summary.json ] && break
    sleep 0.5
done
await 60 "the merge" '[ -s results/summary.json ]'
restarts=$(scontrol show job "$task" 2>/dev/null | grep -o 'Restarts=[0-9]*' | head -1 || true)
echo "task $task: ${restarts:-restarts unknown}"
[ "${restarts#Restarts=}" -ge 1 ] || { echo "the task was not requeued" >&2; exit 1; }

for file in runs.parquet tracks.parquet; do
    cmp "alone/$file" "results/$file"
done
echo "merged result of the array equals the single machine's, byte for byte: $(sha256sum < results/runs.parquet | cut -c1-16)"
