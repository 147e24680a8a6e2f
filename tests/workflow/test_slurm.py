"""The tiny study through a real Slurm on this machine, with and without faults: the same tables.

`make test-slurm` installs Slurm where it is missing; elsewhere these tests are skipped. Slurm's own
records say what became of the jobs.
"""

import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

from .conftest import ROOT, fresh, run

pytestmark = pytest.mark.slurm

SCRIPTS = ROOT / "tests/slurm"
RECORDS = Path("/run/gst-slurm/jobs.log")
# For hung processes. Snakemake waits for ever once Slurm has been silent too long.
LIMIT = 1800
# As a cluster's user calls it, but that it looks at its jobs sooner.
ON_SLURM = "--workflow-profile", str(ROOT / "profiles/slurm")
ON_SLURM += "--slurm-init-seconds-before-status-checks", "3"


@pytest.fixture(scope="module", autouse=True)
def slurm():
    """Slurm, up on this machine."""
    started = run(SCRIPTS / "start_slurm.sh")
    if started.returncode != 0:
        pytest.skip((started.stdout + started.stderr).strip().splitlines()[-1])
    yield
    run(SCRIPTS / "stop_slurm.sh")


class Run:
    """Snakemake at work in a study's folder; what it shows goes to a file."""

    def __init__(self, study, name, *arguments):
        self.log = study.folder / f"{name}.log"
        self.own_logs = study.folder / ".snakemake/log"
        self.earlier = set(self.own_logs.glob("*.log"))
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                study.command(*ON_SLURM, *arguments),
                cwd=study.folder,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def finish(self):
        try:
            return self.process.wait(LIMIT)
        finally:
            self.kill()

    def kill(self):
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()

    def record(self):
        """All that Snakemake has said, by its own log."""
        return "".join(
            file.read_text() for file in set(self.own_logs.glob("*.log")) - self.earlier
        )

    @property
    def name(self):
        """The name that all jobs of the run have in Slurm."""
        return re.search(r"SLURM run ID: (\S+)", self.record())[1]

    def submitted(self):
        return re.findall(r"submitted with SLURM jobid (\d+)", self.record())

    def job(self, rule, running=False):
        """Id of the first job of a rule, or of its group, once submitted, or even at its work."""
        deadline = time.monotonic() + LIMIT
        while self.process.poll() is None and time.monotonic() < deadline:
            match = re.search(rf"slurm_logs/\w*{rule}[\w/]*/(\d+).log", self.record())
            if match and (not running or f"{match[1]}.0" in self.steps()):
                return match[1]
            time.sleep(0.2)
        raise AssertionError(f"no job of {rule}:\n{self.record()}")

    @staticmethod
    def steps():
        """What runs, as JOB.STEP: a rule is at work in step 0 of its job."""
        return run("squeue", "--noheader", "--steps", "--format=%i").stdout.split()

    def log_of(self, job):
        """Slurm's own log of a job that failed."""
        return next(
            self.log.parent.glob(f".snakemake/slurm_logs/**/{job}.log")
        ).read_text()

    def states(self):
        """What became of every job of the run, by Slurm's records: its state by its id."""
        lines = RECORDS.read_text().splitlines()
        jobs = [dict(re.findall(r"(\w+)=(\S*)", line)) for line in lines]
        return {
            job["JobId"]: job["JobState"] for job in jobs if job["Name"] == self.name
        }


def test_a_study_with_faults_of_jobs_is_the_one_of_one_machine(finished_tiny, tmp_path):
    """Two jobs are given too little memory, and one is cancelled; a second attempt mends them."""
    study = fresh(tmp_path / "study")
    memory = "prepare_scans:mem_mb=100 * attempt ** 4"
    run = Run(study, "run", "--set-resources", memory)
    try:
        starved = [run.job(f"prepare_scans/{epoch}_1") for epoch in ("T0", "T1")]
        cancelled = run.job("register_patches", running=True)
        subprocess.run(["scancel", cancelled], check=True)
        assert run.finish() == 0, run.log.read_text()
    finally:
        run.kill()
    assert all("exceeded memory limit" in run.log_of(job) for job in starved)
    states = run.states()
    assert states[cancelled] == "CANCELLED"
    faulty = {cancelled, *starved}
    others = [states[job] for job in run.submitted() if job not in faulty]
    assert others == ["COMPLETED"] * (len(run.submitted()) - 3)
    # short jobs are grouped, and nothing but the target is left to the machine that submits
    assert 5 < len(others) < 20
    assert set(re.findall(r"localrule (\w+)", run.record())) == {"all", "pass_inputs"}
    shown = run.log.read_text()
    assert re.search(r"\d+ of \d+ steps done", shown)
    assert "Finished: " in shown
    # the same study as on one machine
    assert study.tables() == finished_tiny.tables()
    assert study.fields() == finished_tiny.fields()
    assert study.planned() == set()


def test_a_killed_snakemake_is_followed_by_the_documented_recovery(
    finished_tiny, tmp_path
):
    """docs/how-to/cluster.md: cancel what still runs, unlock, run again."""
    study = fresh(tmp_path / "study")
    killed = Run(study, "killed")
    try:
        orphan = killed.job("prepare_scans/T0_1", running=True)
    finally:
        killed.kill()
    locked = Run(study, "locked")
    assert locked.finish() != 0
    assert "--unlock" in locked.log.read_text()
    subprocess.run(["scancel", "--name", killed.name], check=True)
    deadline = time.monotonic() + 60
    while orphan not in killed.states() and time.monotonic() < deadline:
        time.sleep(0.2)
    assert killed.states()[orphan] == "CANCELLED"
    assert Run(study, "unlock", "--unlock").finish() == 0
    again = Run(study, "again")
    assert again.finish() == 0, again.log.read_text()
    assert set(again.states().values()) == {"COMPLETED"}
    assert study.tables() == finished_tiny.tables()
