"""The command `gst` within a test: what it says, and how it ends."""

from click.testing import CliRunner

from gst.cli import main


def command(words, *more):
    """The end of a command; `more` are words with blanks, or paths."""
    return CliRunner().invoke(main, [*words.split(), *map(str, more)])
