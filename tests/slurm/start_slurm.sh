#!/usr/bin/env bash
# start_slurm.sh [--install]: a real one-node Slurm on this machine, on loopback, for tests.
#
# No systemd, no cgroups, no accounting. Twice is as good as once: daemons that run are left alone.
# --install has apt-get install slurm-wlm and munge where they are missing; without it nothing is
# installed. When this machine does not allow it, the last line says why.
# GST_SLURM_CPUS: CPUs that the node says it has (more than there are lets waits overlap; 4).
set -euo pipefail

STATE=/run/gst-slurm # configuration, logs, records; stop_slurm.sh removes it
CPUS=${GST_SLURM_CPUS:-4}
HOST=$(hostname -s)
PORT=16817

refuse() { echo "no Slurm here: $*"; exit 1; }
fail() { tail -n 15 $STATE/log/*.log; refuse "$@"; }
running() { [ -s "$STATE/$1.pid" ] && [ "$(cat "/proc/$(cat "$STATE/$1.pid")/comm" 2>/dev/null)" = "$1" ]; }
within() { # within SECONDS COMMAND...: try until it succeeds
  local tries=$(($1 * 10)); shift
  for _ in $(seq $tries); do "$@" >/dev/null 2>&1 && return 0; sleep 0.1; done; return 1
}

[ "$(id -u)" = 0 ] || refuse "it takes root to run jobs and to write /etc/slurm"
if [ -e /etc/slurm/slurm.conf ] && [ "$(readlink /etc/slurm/slurm.conf)" != $STATE/slurm.conf ]; then
  refuse "/etc/slurm/slurm.conf is another Slurm's; it is left alone"
fi
if { pgrep -x slurmd || pgrep -x slurmctld; } >/dev/null && ! running slurmctld && ! running slurmd; then
  refuse "this machine belongs to a Slurm already; it is left alone"
fi
if ! command -v slurmctld >/dev/null || ! command -v slurmd >/dev/null || ! command -v munged >/dev/null; then
  [ "${1:-}" = --install ] || refuse "slurm-wlm and munge are not installed; \`make test-slurm\` installs them"
  command -v apt-get >/dev/null || refuse "slurm-wlm and munge are missing, and so is apt-get"
  echo "Installing slurm-wlm and munge with apt-get"
  apt-get update -qq
  # the distribution's own services find no configuration, and stay down
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends slurm-wlm munge >/dev/null
fi

if running munged && running slurmctld && running slurmd && timeout 5 scontrol ping >/dev/null; then
  echo "Slurm is up"
  exit 0
fi

mkdir -p $STATE/{log,munge,state,spool} /etc/slurm
chmod 0755 $STATE $STATE/munge
[ -s $STATE/munge.key ] || (umask 077 && head -c 1024 /dev/urandom > $STATE/munge.key)
running slurmctld || cat > $STATE/slurm.conf <<END
ClusterName=test
SlurmctldHost=$HOST(127.0.0.1)
SlurmctldPort=$PORT
SlurmdPort=$((PORT + 1))
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket=$STATE/munge/socket
SlurmctldPidFile=$STATE/slurmctld.pid
SlurmdPidFile=$STATE/slurmd.pid
SlurmctldLogFile=$STATE/log/slurmctld.log
SlurmdLogFile=$STATE/log/slurmd.log
StateSaveLocation=$STATE/state
SlurmdSpoolDir=$STATE/spool
# by process group: by parents (linuxproc), what lost its parent would outlive a cancelled job
ProctrackType=proctrack/pgid
TaskPlugin=task/none
MpiDefault=none
SwitchType=switch/none
# memory limits without cgroups: look each second, and kill what holds more than it asked for
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=1
JobAcctGatherParams=OverMemoryKill
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
DefMemPerCPU=256
SchedulerType=sched/backfill
# start jobs at once, not at the next round of the scheduler
SchedulerParameters=batch_sched_delay=0,sched_interval=2,sched_min_interval=0,bf_interval=2
# refuse a job that can never run; by default it waits for ever
EnforcePartLimits=ALL
SlurmdParameters=config_overrides
ReturnToService=2
KillWait=2
# no lost job comes back behind Snakemake's back
JobRequeue=0
# what became of every job, for the tests to read
JobCompType=jobcomp/filetxt
JobCompLoc=$STATE/jobs.log
AccountingStorageType=accounting_storage/none
NodeName=$HOST NodeAddr=127.0.0.1 CPUs=$CPUS RealMemory=$(awk '/MemTotal/ {printf "%d", $2 / 1024 * 0.9}' /proc/meminfo) State=UNKNOWN
PartitionName=main Nodes=$HOST Default=YES MaxTime=INFINITE DefaultTime=10 State=UP
END
# jobs look for it at this place only: Snakemake's job steps drop SLURM_CONF
ln -sfn $STATE/slurm.conf /etc/slurm/slurm.conf

if ! running munged; then
  rm -f $STATE/munge/socket*
  munged --socket=$STATE/munge/socket --key-file=$STATE/munge.key --pid-file=$STATE/munged.pid \
    --log-file=$STATE/log/munged.log --seed-file=$STATE/munged.seed || fail "munged does not start"
fi
within 10 bash -c "munge -S $STATE/munge/socket -n | unmunge -S $STATE/munge/socket" || fail "munge is silent"
running slurmctld || slurmctld || fail "slurmctld does not start"
within 20 scontrol ping || fail "slurmctld is silent"
running slurmd || slurmd || fail "slurmd does not start"
up() { sinfo -h -n "$HOST" -o %t | grep -qxE 'idle|mix|alloc'; }
within 5 up || scontrol update NodeName="$HOST" State=RESUME 2>/dev/null || true
within 30 up || fail "the node does not come up"
[ "$(timeout 60 srun -n1 hostname)" = "$(hostname)" ] || fail "srun does not run"
echo "Slurm $(sinfo --version | cut -d' ' -f2) is up: node $HOST, $CPUS CPUs"
