"""What scripts read of contacts and wear: one file, or one by one those of patches."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import xarray as xr

from gst.batches import files_of
from gstlib.contact import Contact
from gstlib.io.store import Stored, read_dataset

__all__ = ["changes_of", "contact_of", "contacts_of", "depths_of"]

# Of a height change, what wear is fitted to and scored by.
_CHANGE = "change", "loss", "level_of_detection"


def contact_of(file: Path) -> Contact:
    """The contact in a file."""
    return Contact.from_dataset(read_dataset(file))


def contacts_of(
    folders: Path | Iterable[Path], patches: Iterable[str]
) -> Mapping[str, Contact]:
    """The contacts of patches in the folders of their batches, each read when it is looked up."""
    return Stored(files_of(folders, patches), then=Contact.from_dataset)


def changes_of(
    folders: Path | Iterable[Path], patches: Iterable[str]
) -> Mapping[str, xr.Dataset]:
    """The height changes of patches, likewise."""
    return Stored(files_of(folders, patches), _CHANGE)


def depths_of(
    folders: Path | Iterable[Path], patches: Iterable[str]
) -> Mapping[str, xr.Dataset]:
    """The predicted depths of patches, likewise; none where no wear is predicted."""
    return Stored(files_of(folders, patches))
