"""Errors in a study's input. Each message names the file or key, the value and the remedy.

What a study reports has three levels, those of its log. A fault makes the result wrong: it is an
error, and stops the study unless the config accepts it. A warning may make it wrong. A note is good
to know.
"""

import copy
import logging
from collections.abc import Container, Iterable
from pathlib import Path

__all__ = [
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
    """What makes a result wrong, unless the user knows better and accepts it by its `name`.

    The other parameters are those of an `InputError`.
    """

    def __init__(self, name: str, source: str | Path, problem: str, remedy: str):
        super().__init__(source, problem, remedy)
        self.args, self.name = (name, source, problem, remedy), name

    def __str__(self) -> str:
        accept = f"If it is right as it is, write accept: [{self.name}] in the config."
        return f"{super().__str__()} {accept}"


class OutputError(InputError):
    """A result cannot be written: the disk is full or read-only, or permission is denied."""


class InputsError(GstError):
    """Several errors at once, given as a sequence; the message lists them all.

    What is wrong with several files in the same way is one error of all of them.
    """

    def __str__(self) -> str:
        alike: dict[object, list[GstError]] = {}
        for error in self.args[0]:
            own = (error.problem, error.remedy) if isinstance(error, InputError) else error
            alike.setdefault(own, []).append(error)
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
    return whole


def unaccepted(errors: Iterable[GstError], accepted: Container[str]) -> list[GstError]:
    """Those that stop a study; a fault that is `accepted` by its name is logged as an error."""
    stopping = []
    for error in errors:
        if isinstance(error, FaultError) and error.name in accepted:
            _log.error("%s", InputError.__str__(error))
        else:
            stopping.append(error)
    return stopping


def raise_unless_accepted(errors: Iterable[GstError], accepted: Container[str]) -> None:
    """Raise those that stop a study, as one error."""
    if stopping := unaccepted(errors, accepted):
        raise InputsError(stopping)
