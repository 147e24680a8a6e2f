"""A disk that fills up, a disk that is read-only, and two runs in one folder."""

import subprocess
import time
from pathlib import Path

from report import Count
from study import Study, differing, missing_or_differing

FULL = ("cannot be written: the disk is full", "No space left on device")


def mount(folder: Path, options: str) -> None:
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "none", str(folder)], check=True)


def remount(folder: Path, options: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{options}", str(folder)], check=True)


def unmount(folder: Path) -> None:
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def can_mount(folder: Path) -> bool:
    try:
        mount(folder, "size=100k")
    except (OSError, subprocess.CalledProcessError):
        return False
    unmount(folder)
    return True


def try_disks(folder: Path, reference: dict[str, bytes]) -> list[Count]:
    """With the results alone on a small disk, and with the whole project on it."""
    counts = [
        Count("results folder on a read-only disk"),
        Count("disk with the results full"),
        Count("whole project on a read-only disk"),
        Count("disk with the whole project full"),
    ]
    for whole in (False, True):
        disk = folder / ("whole" if whole else "results") / ("" if whole else "results-tiny")
        disk.mkdir(parents=True)
        mount(disk, "size=1g")
        try:
            study = Study(folder / ("whole" if whole else "results")).make_folder()
            _try_disk(study, disk, reference, *counts[2 * whole : 2 * whole + 2])
        finally:
            unmount(disk)
    return counts


def _try_disk(study, disk, reference, read_only: Count, full: Count) -> None:
    remount(disk, "ro")
    done, said = study.make()
    clear = "the disk is read-only" in said
    _judge(study, read_only, done, said, clear, reference)
    remount(disk, "rw")

    used = _used_kb(disk)
    size = sum(map(len, reference.values())) / 1024
    for share in (0.0, 0.3, 0.6, 0.9):
        # the same disk, a little larger each time: the study goes on from where it stopped
        remount(disk, f"size={int(max(used + share * size, _used_kb(disk)) + 24)}k")
        done, said = study.make_as_told()
        clear = any(word in said for word in FULL) and str(study.results.name) in said
        _judge(study, full, done, said, clear, reference)
    remount(disk, "size=1g")
    done, said = study.make_as_told()
    amiss = missing_or_differing(study.files(), reference) if done else "did not end"
    if amiss or study.leftovers():
        study.tell(said)
        full.add(amiss or f"left behind: {study.leftovers()}")


def _judge(study, count: Count, done: bool, said: str, clear: bool, reference) -> None:
    wrong = differing(study.files(), reference)
    amiss = (
        ("" if clear else "no clear error") if not done else "ended well, which it cannot have"
    ) or (f"half-written: {wrong}" if wrong else "")
    if amiss or "Traceback" in said:
        study.tell(said)
    count.add(amiss)


def _used_kb(disk: Path) -> float:
    df = ["df", "--output=used", "-k", str(disk)]
    return float(subprocess.run(df, capture_output=True, text=True, check=True).stdout.split()[1])


def try_two_runs(folder: Path, reference: dict[str, bytes]) -> list[Count]:
    """A second run while the first is at work, and an attempt to unlock it; both at one moment."""
    later = Count("second run while one is at work")
    unlock = Count("`make unlock` while a run is at work")
    study = Study(folder / "two").make_folder()
    first = study.start()
    while first.poll() is None and not study.processes()["job"]:
        time.sleep(0.1)
    done, said = study.make()
    refused = "" if not done and "another run is at work" in said else "not refused"
    unlocked, told = study.make("unlock")
    allowed = "" if not unlocked and "another run is at work" in told else "not refused"
    said_first = first.communicate()[0]
    harmed = missing_or_differing(study.files(), reference)
    if first.returncode or harmed:
        study.tell(said_first)
        refused = allowed = f"harmed the first run: {harmed}"
    later.add(refused)
    unlock.add(allowed)

    together = Count("two runs started at one moment")
    study = Study(folder / "together").make_folder()
    runs = [study.start(), study.start()]
    said = [run.communicate()[0] for run in runs]
    codes = [run.returncode for run in runs]
    done, last = study.make_as_told()
    print(f"  exit codes {codes}", flush=True)
    amiss = missing_or_differing(study.files(), reference) if done else "did not end"
    if amiss:
        for text in [*said, last]:
            study.tell(text)
    together.add(amiss)
    return [later, unlock, together]
