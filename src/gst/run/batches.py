"""The patches of a study shared out to jobs: a job takes longer to start than a patch to do."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from zlib import crc32

# About as many patches share a job: two jobs for 25, one on each of two cores.
_PER_JOB = 13
# Jobs of a kind; the profile for Slurm sends 20 at a time.
_MOST_BATCHES = 16
# What follows the patch's id in the name of a prepared scan.
_EPOCHS = {"T0": "_T0", "T1": "_T1", "repeat": "_repeat"}


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


def files_of(folders: Path | Iterable[Path], patches: Iterable[str]) -> dict[str, Path]:
    """The files of the patches in the folders of their batches, by patch, where there is one.

    A file has the name of its patch. In the folder of an epoch ``_`` and the epoch follow, which no
    id has. Any other file in a folder is somebody else's.
    """
    folders = [folders] if isinstance(folders, Path) else [*folders]
    files: dict[str, Path] = {}
    for patch in patches:
        for folder in folders:
            epoch = _EPOCHS.get(folder.parent.name, "")
            file = folder / f"{patch}{epoch}.h5"
            if file.is_file():
                files[patch] = file
    return files


def files_by_epoch(
    folders: Mapping[str, Iterable[Path]], patches: Iterable[str]
) -> dict[tuple[str, str], Path]:
    """The files of the patches by patch and epoch; `folders` are those of each epoch's batches."""
    by_epoch = {epoch: files_of(places, patches) for epoch, places in folders.items()}
    return {
        (patch, epoch): files[patch]
        for patch in patches
        for epoch, files in by_epoch.items()
        if patch in files
    }
