"""Errors in a study's input. Each message names the file or key, the value and the remedy.

A study reports messages at the three levels of its log. A fault makes the result wrong: it is an
error, and stops the study unless the config accepts it. A warning may make it wrong. A note is
useful.
"""

import copy
import itertools
import logging
from collections.abc import Container, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Self

__all__ = [
    "FAULTS",
    "NOTE",
    "ConfigError",
    "FaultError",
    "GstError",
    "InputError",
    "InputsError",
    "OutputError",
]
__all__ += ["accepting", "concerning", "raise_unless_accepted", "refuse", "unaccepted"]

_log = logging.getLogger(__name__)

# Between logging's INFO and WARNING.
NOTE = 25
logging.addLevelName(NOTE, "NOTE")

# A message lists no more patches that can be accepted one by one.
_MOST_LISTED = 3
# Meaning of each fault, by the name under which a config accepts it.
FAULTS = {
    "placement": "patches do not match the mesh at their positions in the table and the config",
    "heights": "T1 matches T0, but its heights are half or twice as large",
    "epochs": "on most patches, more area rose than fell from T0 to T1",
    "thickness": "the stone is thinner under the square than any tool",
    "units": "heights are in another unit than the other scans or the mesh",
    "same_scan": "two scans have the same heights",
    "odd_scan": "instruments do not measure such heights, or a part of the file is lost",
    "mesh_step": "the coordinates of a mesh have steps above 20 µm",
    "holes": "the mesh has large holes in the square",
    "face": "most of the face lies beyond the stone",
    "apart": "the active tool does not touch the passive one in its pose",
    "square": "the corners of a square are not as far apart as its size",
    "pressure": "the mean pressure on the square is above 1000 MPa",
    "interlayer": "the interlayer is thinner than the spacing of a scan",
    "overlap": "two patches have more than half of their area in common",
    "memory": "this machine has too little memory",
    "unmatched": "T1 scans do not match T0, or only in another orientation or on another patch",
}


class GstError(Exception):
    """Base of the errors that gstlib raises on purpose, with a message for the user.

    Examples
    --------
    >>> import gstlib
    >>> try:
    ...     gstlib.read_mesh("stone.jpg")
    ... except gstlib.GstError as error:
    ...     print(error)
    stone.jpg: no such file. Correct the path of the mesh in the config.
    """


class InputError(GstError):
    """A file or a value that the user gave cannot be used.

    Parameters
    ----------
    source : str or Path
        The file, or the config key, at fault.
    problem : str
        The problem, with the offending value.
    remedy : str
        The action that solves it.

    Examples
    --------
    >>> import gstlib
    >>> try:
    ...     gstlib.read_scan("1_T0.plu")
    ... except gstlib.InputError as error:
    ...     print((error.source, error.problem), error.remedy, sep="\\n")
    ('1_T0.plu', 'no such file')
    Correct the name in the patch table, or the folder.
    """

    def __init__(self, source: str | Path, problem: str, remedy: str):
        super().__init__(source, problem, remedy)
        self.source, self.remedy = str(source), remedy
        self.problem = problem.rstrip(".")

    def about(
        self, source: str | Path, problem: str, remedy: str | None = None
    ) -> Self:
        """The same error of another source, in other words."""
        other = copy.copy(self)
        other.source, other.problem = str(source), problem.rstrip(".")
        other.remedy = remedy or self.remedy
        return other

    def __str__(self) -> str:
        # A problem that is a list ends its last line itself.
        end = " " if self.problem.endswith("\n ") else ". "
        return f"{self.source}: {self.problem}{end}{self.remedy}"


class ConfigError(InputError):
    """A value in the config file or a row of the patch table cannot be used.

    Examples
    --------
    >>> import gstlib
    >>> error = gstlib.ConfigError("load.force_N", "is -200", "Give a positive force.")
    >>> error.source, error.problem
    ('load.force_N', 'is -200')
    >>> print(error)
    load.force_N: is -200. Give a positive force.
    """


class FaultError(InputError):
    """A problem that makes a result wrong, unless the config accepts it.

    Parameters
    ----------
    name : str
        A key of `FAULTS`, under which a config accepts the fault.
    source, problem, remedy
        As of an `InputError`.
    patches : sequence of str
        The patches that the fault concerns. It is empty if it does not concern single patches.
    """

    def __init__(
        self,
        name: str,
        source: str | Path,
        problem: str,
        remedy: str,
        patches: Sequence[str] = (),
    ):
        assert name in FAULTS, name
        super().__init__(source, problem, remedy)
        self.args = (name, source, problem, remedy, patches)
        self.name, self.patches = name, tuple(map(str, patches))

    def __str__(self) -> str:
        by_patch = [f"{self.name}:{patch}" for patch in self.patches]
        accept = f"accept: [{self.name}]"
        if len(by_patch) > _MOST_LISTED:
            accept += (
                f" for all patches, or {by_patch[0]} and likewise for single ones,"
            )
        elif by_patch:
            accept = f"accept: [{', '.join(by_patch)}], or {accept} for all patches,"
        return (
            f"{super().__str__()} If the input is right, write {accept} in the config."
        )

    def is_accepted(self, accepted: Container[str]) -> bool:
        """Whether `accepted` has the fault's name, or ``name:patch`` for each of its patches."""
        if self.name in accepted:
            return True
        by_patch = [f"{self.name}:{patch}" in accepted for patch in self.patches]
        return bool(by_patch) and all(by_patch)


class OutputError(InputError):
    """A result cannot be written: the disk is full or read-only, or permission is denied."""


class InputsError(GstError):
    """Several errors at once, as a sequence. The message lists them all.

    If several files have the same problem, it is one error for all of them.
    """

    def __str__(self) -> str:
        alike: dict[object, list[GstError]] = {}
        for error in self.args[0]:
            same: object = error
            if isinstance(error, InputError):
                same = getattr(error, "name", None), error.problem, error.remedy
            alike.setdefault(same, []).append(error)
        texts = [str(_as_one(errors)) for errors in alike.values()]
        if len(texts) == 1:
            return texts[0]
        # Lists within the list are indented further.
        listed = "".join("\n  - " + text.replace("\n", "\n    ") for text in texts)
        return f"{len(texts)} problems{listed}"


def _as_one(errors: list[Any]) -> GstError:
    """Errors that differ in their source alone, as one."""
    first = errors[0]
    if len(errors) == 1 or not isinstance(first, InputError):
        return first
    whole = first.about(", ".join(error.source for error in errors), first.problem)
    if isinstance(whole, FaultError):
        by_fault = [error.patches for error in errors]
        # a fault without patches can be accepted only as a whole
        whole.patches = tuple(itertools.chain(*by_fault)) if all(by_fault) else ()
    return whole


def unaccepted(errors: Iterable[GstError], accepted: Container[str]) -> list[GstError]:
    """The errors that stop a study. Each fault that is `accepted` is logged as an error.

    `accepted` contains names of faults, and ``name:patch`` for single patches.
    """
    return [error for error in errors if not _passes(error, accepted)]


def _passes(error: GstError, accepted: Container[str]) -> bool:
    """Whether an error is a fault that is accepted. If so, it is logged."""
    if passes := isinstance(error, FaultError) and error.is_accepted(accepted):
        _log.error("%s", InputError.__str__(error))
    return passes


def raise_unless_accepted(errors: Iterable[GstError], accepted: Container[str]) -> None:
    """Raise the errors that stop a study, as one. For `accepted`, see `unaccepted`."""
    if stopping := unaccepted(errors, accepted):
        raise InputsError(stopping)


# The accepted faults and the patches concerned, for checks deep within a reader.
_ACCEPTED: ContextVar[Container[str]] = ContextVar("accepted", default=())
_CONCERNED: ContextVar[Sequence[str]] = ContextVar("concerned", default=())


def accepting(accepted: Container[str]) -> AbstractContextManager[None]:
    """Let `refuse` accept these faults. For `accepted`, see `unaccepted`."""
    return _set(_ACCEPTED, accepted)


def concerning(patches: Sequence[str]) -> AbstractContextManager[None]:
    """Let the faults of `refuse` concern these patches."""
    return _set(_CONCERNED, patches)


@contextmanager
def _set(variable: ContextVar, value: object) -> Iterator[None]:
    """Set a variable for a while."""
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def refuse(fault: FaultError) -> None:
    """Raise a fault, unless the caller accepts it (`accepting`)."""
    fault.patches = fault.patches or tuple(_CONCERNED.get())
    if not _passes(fault, _ACCEPTED.get()):
        raise fault
