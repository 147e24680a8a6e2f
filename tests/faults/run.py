"""Kill, starve and damage the tiny study, and count what it survives: `make test-faults`.

Every case runs a copy of the project in a folder of its own with `make study`, as a user does, and
compares all results byte for byte with those of a run that nothing disturbed. A fault is survived
if no half-written result lies in its place after it, an error names what the study cannot mend by
itself, and the study, run again as its messages say, ends with the undisturbed results.
"""

import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import psutil

ROOT = Path(__file__).parents[2]
RESULTS = "results-tiny"
NO_RESULTS = {"logs", "report.html"}  # how long a job took, and what it said
FULL = ("cannot be written: the disk is full", "No space left on device")
# What is amiss after each fault, by its kind; empty where it was survived.
OUTCOMES: dict[str, list[str]] = defaultdict(list)


class Study:
    """A copy of the project with the tiny study in it; the environment is this one."""

    def __init__(self, folder, reference, finished=None):
        self.folder, self.results, self.reference = folder, folder / RESULTS, reference
        if finished:  # dates and Snakemake's records included
            shutil.copytree(finished, folder, symlinks=True)
            return
        folder.mkdir(parents=True, exist_ok=True)
        names = "git ls-files --cached --others --exclude-standard"
        copy = f"{names} | tar -c --ignore-failed-read -T - | tar -x -C {folder}"
        subprocess.run(copy, shell=True, cwd=ROOT, check=True)
        (folder / ".venv").symlink_to(sys.prefix)

    def start(self):
        """`make study` in a session of its own, so that all of it can be killed at once."""
        return subprocess.Popen(
            ["make", "-o", ".venv/ready", "study", "CONFIG=config/tiny.yaml"],
            cwd=self.folder,
            start_new_session=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )

    def make(self):
        """Whether `make study`, once jobs of a killed run had ended, ended well; and its words."""
        while True:
            process = self.start()
            text = process.communicate()[0]
            if process.returncode == 0 or "are still at work" not in text:
                return process.returncode == 0, text
            time.sleep(2)

    def processes(self, kind):
        """The run's jobs (`job`), or its Snakemake (`run`), as they are now."""
        here = str(self.folder.resolve())
        for process in psutil.process_iter(["cwd", "cmdline"]):
            command = process.info["cmdline"] or []
            is_job = any("/.snakemake/scripts/" in word for word in command)
            is_run = "gst.run.scheduler" in command and not is_job
            if process.info["cwd"] == here and (is_job if kind == "job" else is_run):
                yield process

    def files(self):
        """Every result by its name; hidden files are none."""
        return {
            str(file.relative_to(self.results)): file.read_bytes()
            for file in sorted(self.results.rglob("[!.]*"))
            if file.is_file() and NO_RESULTS.isdisjoint(file.parts)
        }

    def half_written(self):
        """Results that are there, but not those of the undisturbed study."""
        wrong = [
            name
            for name, text in self.files().items()
            if self.reference.get(name) != text
        ]
        return f"half-written: {', '.join(wrong)}" if wrong else ""

    def end(self):
        """What is amiss once the study has been run to its end."""
        done, text = self.make()
        missing = sorted(self.reference.keys() - self.files().keys())
        left = [file.name for file in self.results.rglob("*.part")]
        amiss = "" if done else "the study does not end"
        amiss = amiss or self.half_written() or ", ".join(missing + left)
        if amiss:
            print(
                "\n".join("    | " + line for line in text.splitlines()[-40:]),
                flush=True,
            )
        return amiss


def count(fault, amiss):
    OUTCOMES[fault].append(amiss)
    print(f"  {fault}: {'LOST: ' + amiss if amiss else 'survived'}", flush=True)


def kill_at_random(study, kind, choose, duration):
    """SIGKILL to one job, to Snakemake alone, or to the whole run; then what is amiss."""
    process = study.start()
    time.sleep(choose.uniform(0.02, 0.35) * duration)
    while process.poll() is None:
        if kind == "all":  # whatever they start: Snakemake has a group of its own
            for each in [
                *psutil.Process(process.pid).children(recursive=True),
                process,
            ]:
                each.kill()
        elif running := [*study.processes(kind)]:
            choose.choice(running).kill()
        else:
            time.sleep(0.05)
            continue
        break
    process.communicate()
    while [*study.processes("job")]:  # those that outlive Snakemake
        time.sleep(0.2)
    if kind == "job" and process.returncode == 0:
        return "a killed job passed for done"
    return study.half_written()


def fill_disk(folder, reference):
    """The results on a read-only disk, then on one that is full again and again."""
    disk = folder / RESULTS
    disk.mkdir(parents=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1g", "none", disk], check=True)
    try:
        study = Study(folder, reference)
        size = sum(map(len, reference.values()))
        for share in (None, 0.0, 0.3, 0.6, 0.9):
            options = (
                "ro" if share is None else f"rw,size={int(share * size) + 24 * 1024}"
            )
            subprocess.run(["mount", "-o", f"remount,{options}", disk], check=True)
            done, text = study.make()
            words = ("the disk is read-only",) if share is None else FULL
            clear = not done and any(word in text for word in words)
            amiss = study.half_written() if clear else "no clear error"
            count("read-only disk" if share is None else "full disk", amiss)
        subprocess.run(["mount", "-o", "remount,size=1g", disk], check=True)
        count("full disk, once there is room", study.end())
    finally:
        subprocess.run(["umount", "--lazy", disk], check=True)


def cut_off(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip_bit(path):
    """One bit in the middle."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


DAMAGES = {"file cut off": cut_off, "one bit of a file flipped": flip_bit}
DAMAGED = (
    "specimen/mesh.stl",
    "specimen/scans/7_T0.plu",
    "surfaces/T0/1/7_T0.h5",
    "macroscale/contact.h5",
    "tables/patch_pressures.csv",
)


def after_damage(study, file):
    """What is amiss after the study has met a damaged file, which it makes again."""
    done, text = study.make()
    if not done or f"again: {file} is not as it was made" not in text:
        return f"not seen: {text[-2000:]}"
    return study.end()


def main():
    choose = random.Random(1)
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        folder = Path(name)
        started = time.monotonic()
        finished = Study(folder / "undisturbed", {})
        done, text = finished.make()
        if not done:
            raise SystemExit(text)
        duration, reference = time.monotonic() - started, finished.files()
        for number, kind in enumerate(7 * ("job", "run", "all")):
            study = Study(folder / f"kill{number}", reference)
            amiss = kill_at_random(study, kind, choose, duration)
            count(f"SIGKILL ({kind})", amiss or study.end())
        if os.geteuid() == 0:
            fill_disk(folder / "disk", reference)
        for fault, damage in DAMAGES.items():
            for file in DAMAGED:
                place = folder / f"{damage.__name__}-{file.replace('/', '-')}"
                study = Study(place, reference, finished.folder)
                damage(study.results / file)
                count(fault, after_damage(study, file))
    for fault, outcomes in OUTCOMES.items():
        print(f"{fault}: {len(outcomes)} tried, {sum(map(bool, outcomes))} lost")
    return int(any(map(any, OUTCOMES.values())))


if __name__ == "__main__":
    sys.exit(main())
