"""Ill-treat the tiny study and count what it survives: `make test-faults` (half an hour or more).

Every case runs a copy of the project in a folder of its own with `make study`, as a user does, and
compares all results byte for byte with those of a run that nothing disturbed.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from damage import try_damage
from disks import can_mount, try_disks, try_two_runs
from kills import try_kills
from report import table
from study import Study


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", help="kills, disks, two, damage; all by default")
    parser.add_argument("--kills", type=int, default=21)
    parser.add_argument("--kills-in-a-study", type=int, default=7)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    kinds = arguments.kinds or ["kills", "disks", "two", "damage"]
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        folder = Path(name)
        finished = Study(folder / "undisturbed").make_folder()
        started = time.monotonic()
        done, said = finished.make()
        duration = time.monotonic() - started
        if not done:
            finished.tell(said)
            return 1
        reference = finished.files()
        print(f"undisturbed: {len(reference)} results in {duration:.0f} s", flush=True)
        counts = []
        if "kills" in kinds:
            each = arguments.kills, arguments.kills_in_a_study, arguments.seed
            counts += try_kills(folder, reference, duration, *each)
        if "disks" in kinds and can_mount(folder):
            counts += try_disks(folder, reference)
        elif "disks" in kinds:
            print("disks: skipped, no right to mount a small one (root has it)")
        if "two" in kinds:
            counts += try_two_runs(folder, reference)
        if "damage" in kinds:
            counts += try_damage(folder, finished, reference)
    print("\n" + table(counts))
    return int(any(count.lost for count in counts))


if __name__ == "__main__":
    sys.exit(main())
