"""The patches of a study shared out to jobs: a job takes longer to start than a patch to do."""

from collections.abc import Sequence
from zlib import crc32

# About as many patches share a job: two jobs for 25, one on each of two cores.
_PER_JOB = 13
# Jobs of a kind; the profile for Slurm sends 20 at a time.
_MOST_BATCHES = 16


def share_out(
    patches: Sequence[str], per_job: float | None = None
) -> dict[str, list[str]]:
    """The patches of each batch, in their order, by the batch's name.

    A patch stays in its batch when others come or go: its id alone decides, among as many batches
    as a power of two. Only where that number changes, at about 13, 26, 52 … patches, all move.
    About `per_job` share a job, or more where that made more than 16 batches.
    """
    count = 1
    while count < _MOST_BATCHES and len(patches) > count * (per_job or _PER_JOB):
        count *= 2
    batches: dict[str, list[str]] = {str(number + 1): [] for number in range(count)}
    for patch in patches:
        number = crc32(patch.encode()) % count
        batches[str(number + 1)].append(patch)
    return {batch: members for batch, members in batches.items() if members}
