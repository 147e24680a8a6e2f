"""What the three formats share: how numbers look, and what is handed on."""

from dataclasses import dataclass

__all__ = ["AS_TRIANGLES", "EXPORT_AGAIN", "NUMBER", "PlainMesh", "quote", "unix"]

EXPORT_AGAIN = "Export or copy the mesh again."
AS_TRIANGLES = "Export it again, as triangles."

# A number as all three formats write it. Possessive (++), so that no text takes long to refuse.
NUMBER = rb"(?i:[-+]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:e[-+]?[0-9]++)?|[-+]?(?:nan|inf))"


@dataclass(frozen=True)
class PlainMesh:
    """The shape in a mesh file, as a file of the same format with nothing else in it.

    Attributes
    ----------
    content : bytes
    faces : int
        Triangles that a reader must find in it.
    """

    content: bytes
    faces: int


def quote(line: bytes) -> str:
    """The beginning of a line of a file, for a message."""
    text = line[:40].decode("ascii", errors="replace")
    return repr(text + "…" if len(line) > 40 else text)


def unix(content: bytes) -> bytes:
    """A text with line ends as everywhere but on some old systems."""
    return content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
