"""Errors in a study's input. Each message names the file or key, the value and the remedy.

What a study reports has three levels, those of its log. A fault makes the result wrong: it is an
error, and stops the study unless the config accepts it. A warning may make it wrong. A note is good
to know.
"""

import copy
import itertools
import logging
from collections.abc import Container, Iterable, Sequence
from pathlib import Path

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
__all__ += ["raise_unless_accepted", "unaccepted"]

_log = logging.getLogger(__name__)

# Between logging's INFO and WARNING.
NOTE = 25
logging.addLevelName(NOTE, "NOTE")

# What each fault says, by the name under which a config accepts it.
FAULTS = {
    "placement": "patches do not lie on the mesh as the table and the config say",
    "epochs": "more rose than fell from T0 to T1 on most patches",
    "thickness": "the stone is thinner under the square than any tool",
    "units": "heights are in another unit than those of the other scans or of the mesh",
    "same_scan": "two scans have the same heights",
}


class GstError(Exception):
    """Base of the errors that gstlib raises on purpose; the message is meant for the user."""


class InputError(GstError):
    """A file or a value that the user gave cannot be used.

    Parameters
    ----------
    source : str or Path
        The file, or the config key, at fault.
    problem : str
        What is wrong, with the offending value.
    remedy : str
        What to do about it.
    """

    def __init__(self, source: str | Path, problem: str, remedy: str):
        super().__init__(source, problem, remedy)
        self.source, self.problem, self.remedy = str(source), problem.rstrip("."), remedy

    def __str__(self) -> str:
        # A problem that is a list ends its last line itself.
        end = " " if self.problem.endswith("\n ") else ". "
        return f"{self.source}: {self.problem}{end}{self.remedy}"


class ConfigError(InputError):
    """A value in the config file or a row of the patch table cannot be used."""


class FaultError(InputError):
    """A judgement that a result is wrong, which a user who knows better can accept.

    Parameters
    ----------
    name : str
        A key of `FAULTS`, under which a config accepts the fault.
    source, problem, remedy
        As of an `InputError`.
    patches : sequence of str
        The patches that the fault concerns; empty if it does not concern single patches.
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
        accept = f"accept: [{', '.join(by_patch or [self.name])}]"
        for_all = f", or accept: [{self.name}] for all patches" if by_patch else ""
        hint = f"If it is right as it is, write {accept}{for_all} in the config."
        return f"{super().__str__()} {hint}"

    def is_accepted(self, accepted: Container[str]) -> bool:
        """Whether `accepted` has the fault's name, or ``name:patch`` for each of its patches."""
        if self.name in accepted:
            return True
        by_patch = [f"{self.name}:{patch}" in accepted for patch in self.patches]
        return bool(by_patch) and all(by_patch)


class OutputError(InputError):
    """A result cannot be written: the disk is full or read-only, or permission is denied."""


class InputsError(GstError):
    """Several errors at once, given as a sequence; the message lists them all.

    What is wrong with several files in the same way is one error of all of them.
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


def _as_one(errors: list[GstError]) -> GstError:
    """Errors that differ in their source alone, as one."""
    first = errors[0]
    if len(errors) == 1 or not isinstance(first, InputError):
        return first
    whole = copy.copy(first)
    whole.source = ", ".join(error.source for error in errors if isinstance(error, InputError))
    if isinstance(whole, FaultError):
        by_fault = [error.patches for error in errors if isinstance(error, FaultError)]
        # a fault without patches can be accepted only as a whole
        whole.patches = tuple(itertools.chain(*by_fault)) if all(by_fault) else ()
    return whole


def unaccepted(errors: Iterable[GstError], accepted: Container[str]) -> list[GstError]:
    """The errors that stop a study; each fault that is `accepted` is logged as an error.

    `accepted` holds names of faults, and ``name:patch`` for single patches.
    """
    stopping = []
    for error in errors:
        if isinstance(error, FaultError) and error.is_accepted(accepted):
            _log.error("%s", InputError.__str__(error))
        else:
            stopping.append(error)
    return stopping


def raise_unless_accepted(errors: Iterable[GstError], accepted: Container[str]) -> None:
    """Raise the errors that stop a study, as one; `accepted` is that of `unaccepted`."""
    if stopping := unaccepted(errors, accepted):
        raise InputsError(stopping)
