"""What can be wrong with a study's input, said so that the reader knows what to do about it."""

from collections.abc import Sequence
from pathlib import Path

__all__ = ["ConfigError", "GstError", "InputError", "InputsError", "OutputError"]


class GstError(Exception):
    """Base of the errors that gstlib raises on purpose; its message is meant for the user."""


class InputError(GstError):
    """A file or value of the user's cannot be used.

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
        # a problem that is a list ends its last line itself
        end = " " if self.problem.endswith("\n ") else ". "
        return f"{self.source}: {self.problem}{end}{self.remedy}"


class ConfigError(InputError):
    """A value in the config file or a row of the patch table cannot be used."""


class OutputError(InputError):
    """A result cannot be written where the user wants it: disk full, read-only, not allowed."""


class InputsError(GstError):
    """Several things are wrong; the message lists them all."""

    def __init__(self, errors: Sequence[GstError]):
        super().__init__(errors)
        self.errors = tuple(errors)

    def __str__(self) -> str:
        if len(self.errors) == 1:
            return str(self.errors[0])
        # lists within the list stand further in
        listed = "\n  - ".join(str(error).replace("\n", "\n    ") for error in self.errors)
        return f"{len(self.errors)} problems\n  - {listed}"
