"""Read the contacts that other jobs have solved; apart, since few scripts need the solver."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from gst.run.stored import files_of
from gstlib.contact import Contact
from gstlib.io.store import Stored, read_dataset


def contact_of(file: Path) -> Contact:
    """The contact in a file."""
    return Contact.from_dataset(read_dataset(file))


def contacts_of(
    folders: Path | Iterable[Path], patches: Iterable[str]
) -> Mapping[str, Contact]:
    """The contacts of patches in the folders of their batches, each read when it is looked up."""
    return Stored(files_of(folders, patches), then=Contact.from_dataset)
