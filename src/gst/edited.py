"""A config or a table with other values, and its comments and layout as they were.

No library at hand writes YAML back with its comments. PyYAML says where in the text each value
stands, and only there it is changed.
"""

import csv
import io
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import yaml

from gst.strict_yaml import as_yaml
from gstlib.errors import ConfigError
from gstlib.io.text_rows import decoded, separator_of

__all__ = ["Cells", "text_of", "with_cells", "with_values"]

# Of a row's cells, by column, those that change; None if the row goes.
Cells: TypeAlias = Callable[[Mapping[str, str]], Mapping[str, object] | None]


def text_of(path: Path) -> str:
    """The text of a config or a table that is to be changed."""
    try:
        return decoded(path.read_bytes())
    except UnicodeDecodeError:
        problem = "is no text in UTF-8, and cannot be changed here"
        raise ConfigError(path, problem, "Save it as CSV in UTF-8.") from None


def with_values(text: str, values: Mapping[str, Any]) -> str:
    """The text of a config with values at keys such as ``scans.mould.invert``, added where absent.

    >>> given = "a:\\n  b: 1  # one\\n\\nc: {d: 3}\\n"
    >>> print(with_values(given, {"a.b": 2, "a.e": "TODO", "c.f": "1, 2", "g.h": [1.5]}), end="")
    a:
      b: 2  # one
      e: TODO
    <BLANKLINE>
    c: {d: 3, f: '1, 2'}
    g: {h: [1.5]}
    """
    for key, value in values.items():
        text = _with_value(text, key.split("."), value)
    return text


def _with_value(text: str, names: Sequence[str], value: Any) -> str:
    node = yaml.compose(text)
    for depth, name in enumerate(names):
        inside = {}
        if isinstance(node, yaml.MappingNode):
            inside = {key.value: (key, of) for key, of in node.value}
        if name not in inside:
            for other in reversed(names[depth + 1 :]):
                value = {other: value}
            return _with_pair(text, node, name, value)
        key, node = inside[name]
    # of a list or section in lines of its own, behind the key's colon
    start = key.end_mark.index + 1 if _in_lines(node) else node.start_mark.index
    return f"{text[:start].rstrip(' ')} {_flow(value)}{text[_end(node) :]}"


def _with_pair(text: str, section: yaml.Node | None, name: str, value: Any) -> str:
    """A section, the whole config or null, with a further key at its end."""
    pair = f"{name}: {_flow(value)}"
    if section is None or not isinstance(section, yaml.MappingNode):
        start, end = (section.start_mark.index, _end(section)) if section else (len(text),) * 2
        return f"{text[:start]}{f'{{{pair}}}' if section else pair}{text[end:]}"
    end = _end(section)
    if not _in_lines(section):
        comma = ", " if section.value else ""
        return f"{text[: end - 1]}{comma}{pair}{text[end - 1 :]}"
    line_ends = text.find("\n", end)
    end = len(text) if line_ends < 0 else line_ends
    return f"{text[:end]}\n{' ' * section.start_mark.column}{pair}{text[end:]}"


def _in_lines(node: yaml.Node) -> bool:
    return isinstance(node, yaml.CollectionNode) and not node.flow_style


def _end(node: yaml.Node) -> int:
    """Where a value ends in the text, without blank lines and comments behind it."""
    while _in_lines(node):
        last = node.value[-1]
        node = last[1] if isinstance(node, yaml.MappingNode) else last
    return node.end_mark.index


def _flow(value: Any) -> str:
    """A value in one line of YAML."""
    # within a list, as what stands in a section of one line has to be quoted
    written = as_yaml([value], default_flow_style=True, width=1 << 20)
    return written.removesuffix("\n")[1:-1]


def with_cells(
    text: str,
    cells: Cells,
    more: Collection[Mapping[str, object]] = (),
    renamed: Mapping[str, str] | None = None,
) -> str:
    """The text of a table with some cells of its rows changed, and columns added where absent.

    Rows may go, and `more` come at its end. `renamed` has other names of columns.

    >>> print(with_cells("# places\\npatch;x\\n1; 2,5\\n", lambda row: {"note": row["x"]}), end="")
    # places
    patch;x;note
    1;2,5;2,5
    """
    lines: list[str | None] = [*text.splitlines()]
    numbers = [n for n, line in enumerate(text.splitlines()) if _is_row(line)]
    if not numbers:
        return text
    mark = separator_of(lines[numbers[0]] or "") or ","
    header, *rows = (next(csv.reader([lines[n] or ""], delimiter=mark)) for n in numbers)
    known = [name.strip().lower() for name in header]
    known = [(renamed or {}).get(name, name) for name in known]
    read = [dict(zip(known, map(str.strip, row), strict=False)) for row in rows]
    changed = [cells(row) for row in read]
    named = dict.fromkeys(name for row in [*changed, *more] for name in row or ())
    added = [name for name in named if name not in known]
    names = [*known, *added]
    if added:
        lines[numbers[0]] = _joined([*header, *added], mark)
    for n, row, new in zip(numbers[1:], read, changed, strict=True):
        if new is None:
            lines[n] = None
        elif added or new:
            lines[n] = _row(row | dict(new), names, mark)
    lines += [_row(row, names, mark) for row in more]
    return "".join(f"{line}\n" for line in lines if line is not None)


def _is_row(line: str) -> bool:
    return not line.lstrip(' "').startswith("#") and line.strip(' \t,;"') != ""


def _row(cells: Mapping[str, object], names: Sequence[str], mark: str) -> str:
    return _joined([str(cells.get(name, "")) for name in names], mark)


def _joined(cells: Sequence[str], mark: str) -> str:
    line = io.StringIO()
    csv.writer(line, delimiter=mark, lineterminator="").writerow(cells)
    return line.getvalue()
