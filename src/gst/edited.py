"""A config or a table with other values, and its comments and layout as they were.

No library at hand writes YAML back with its comments. PyYAML says where in the text each value
stands, and only there it is changed.
"""

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import yaml

from gstlib.io.text import separator_of

__all__ = ["Cells", "with_cells", "with_values"]

# Of a row's cells, by column, those that change.
Cells: TypeAlias = Callable[[Mapping[str, str]], Mapping[str, object]]


def with_values(text: str, values: Mapping[str, Any]) -> str:
    """The text of a config with values at keys such as ``scans.mould.invert``, added where absent.

    >>> given = "a:\\n  b: 1  # one\\n\\nc: {d: 3}\\n"
    >>> print(with_values(given, {"a.b": 2, "a.e": "TODO", "c.f": None, "g.h": [1.5]}), end="")
    a:
      b: 2  # one
      e: TODO
    <BLANKLINE>
    c: {d: 3, f: null}
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
    layout: dict[str, Any] = {"default_flow_style": True, "width": 1 << 20, "sort_keys": False}
    written: str = yaml.safe_dump(value, allow_unicode=True, **layout)
    return written.removesuffix("\n").removesuffix("\n...")


def with_cells(text: str, cells: Cells) -> str:
    """The text of a table with some cells of its rows changed, and columns added where absent.

    >>> print(with_cells("# places\\npatch;x\\n1; 2,5\\n", lambda row: {"note": row["x"]}), end="")
    # places
    patch;x;note
    1;2,5;2,5
    """
    lines = text.splitlines()
    numbers = [n for n, line in enumerate(lines) if not line.lstrip(' "').startswith("#")]
    numbers = [n for n in numbers if lines[n].strip(' \t,;"')]
    if not numbers:
        return text
    mark = separator_of(lines[numbers[0]]) or ","
    header, *rows = (next(csv.reader([lines[n]], delimiter=mark)) for n in numbers)
    known = [name.strip().lower() for name in header]
    read = [dict(zip(known, map(str.strip, row), strict=False)) for row in rows]
    changed = [cells(row) for row in read]
    added = [
        name
        for name in dict.fromkeys(name for row in changed for name in row)
        if name not in known
    ]
    for n, row, new in zip(numbers, [{}, *read], [{}, *changed], strict=True):
        if n == numbers[0]:
            written = [*header, *added]
        else:
            written = [str((row | dict(new)).get(name, "")) for name in [*known, *added]]
        if added or new:
            lines[n] = _joined(written, mark)
    return "\n".join(lines) + "\n"


def _joined(cells: Sequence[str], mark: str) -> str:
    line = io.StringIO()
    csv.writer(line, delimiter=mark, lineterminator="").writerow(cells)
    return line.getvalue()
