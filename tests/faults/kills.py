"""SIGKILL at random moments: to one job, to Snakemake alone (its jobs run on), to the whole run."""

import random
import time
from pathlib import Path

from report import Count
from study import Study, differing, missing_or_differing

KINDS = {
    "job": "SIGKILL to one job",
    "run": "SIGKILL to Snakemake alone",
    "all": "SIGKILL to the whole run",
}


def try_kills(
    folder: Path, reference: dict[str, bytes], duration: float, kills: int, a_study: int, seed: int
) -> list[Count]:
    """Kill `kills` times, up to `a_study` times in one study, which is then run to its end.

    A kill is survived if no half-written result lies in its place after it, and the study, run
    again as its messages say, ends with the results of the undisturbed one.
    """
    choose = random.Random(seed)
    counts = {kind: Count(name) for kind, name in KINDS.items()}
    kinds = [list(KINDS)[number % len(KINDS)] for number in range(kills)]
    choose.shuffle(kinds)
    number = 0
    while kinds:
        number += 1
        study = Study(folder / f"kills{number}").make_folder()
        amiss = []
        while kinds and len(amiss) < a_study:
            wrong = _kill_once(study, kinds[0], choose, reference, duration)
            if wrong is None:  # it had ended before
                break
            amiss.append((kinds.pop(0), wrong))
        done, said = study.make_as_told()
        end = missing_or_differing(study.files(), reference) if done else "the study did not end"
        if done and study.leftovers():
            end = f"left behind: {study.leftovers()}"
        if end:
            study.tell(said)
        for kind, wrong in amiss:
            counts[kind].add(wrong or end)
    return list(counts.values())


def _kill_once(study, kind, choose, reference, duration) -> str | None:
    """What is amiss after a kill at a random moment; None if the run had ended before."""
    after = choose.uniform(0.02, 0.35) * duration
    if any((study.folder / ".snakemake/locks").glob("*")):
        unlocked, told = study.make("unlock")
        if not unlocked:
            return f"not unlocked: {told}"
    process = study.start()
    started = time.monotonic()
    killed = False
    while process.poll() is None and not killed:
        time.sleep(0.05)
        if time.monotonic() - started > after:
            killed = study.kill(process, kind, choose)
    said = process.communicate()[0]
    if not killed:
        return None
    at = f"{time.monotonic() - started:.1f} s"
    while study.processes()["job"]:  # those that outlive Snakemake
        if kind == "all":
            return "a job outlived the kill"
        if kind == "run" and "make unlock" in said:
            return "told to unlock while its jobs were at work"
        time.sleep(0.2)
    wrong = differing(study.files(), reference)
    print(f"  killed ({kind}) after {at}, {len(study.files())} results there", flush=True)
    if kind == "job" and process.returncode == 0:
        return "a killed job passed for done"
    return f"half-written: {wrong}" if wrong else ""
