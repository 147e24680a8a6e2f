#!/usr/bin/env bash
# stop_slurm.sh: ends the jobs and the daemons of start_slurm.sh, each by its own pid, and removes
# their files. What stop_slurm.sh did not start, it does not touch.
set -uo pipefail

STATE=/run/gst-slurm
[ -d $STATE ] || exit 0
if timeout 5 scontrol ping >/dev/null 2>&1 && [ "$(readlink /etc/slurm/slurm.conf)" = $STATE/slurm.conf ]; then
  # a slurmd that ends leaves its jobs running
  scancel --user=root
  for _ in $(seq 100); do [ -z "$(squeue -h)" ] && break; sleep 0.1; done
fi
for name in slurmd slurmctld munged; do
  pid=$(cat $STATE/$name.pid 2>/dev/null) || continue
  [ "$(cat "/proc/$pid/comm" 2>/dev/null)" = $name ] || continue
  kill "$pid"
  for _ in $(seq 300); do [ -d "/proc/$pid" ] || break; sleep 0.1; done
  [ ! -d "/proc/$pid" ] || { echo "stop_slurm: $name ($pid) still runs" >&2; exit 1; }
done
[ "$(readlink /etc/slurm/slurm.conf)" = $STATE/slurm.conf ] && rm /etc/slurm/slurm.conf
rm -rf $STATE
