"""A config or a table with other values, in which all else stays as it was, byte for byte.

PyYAML and `csv` read the text, and it is changed only at the values that they found. The round trip
of ruamel.yaml is no substitute: it alters blanks, indents and nulls elsewhere, even in most of the
shipped configs, and it does not show where the value of an empty key belongs.
"""

import codecs
import copy
import csv
import io
import json
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import yaml

from gst.config.strict_yaml import as_yaml, parse_yaml
from gst.config.user_tables import alike, records_of
from gstlib.errors import ConfigError
from gstlib.io.files import write_whole

__all__ = ["Cells", "save_text", "text_of", "with_cells", "with_values"]

# Of a row's cells, by column, those that change; None if the row goes.
Cells: TypeAlias = Callable[[Mapping[str, str]], Mapping[str, object] | None]
# Start and end of a part of a text, and the new part.
_Splice: TypeAlias = tuple[int, int, str]

_CONFIG, _TABLE = "the config", "the patch table"
_DECIMAL = re.compile(r"[-+]?\d*[.,]\d+")


def text_of(path: Path) -> str:
    """The text of a config or a table, with its line ends and its byte order mark.

    Raises a `ConfigError` if the file cannot be opened, or is not text.
    """
    try:
        content = path.read_bytes()
        text = content.decode(_encoding(content))
    except OSError as error:
        problem, remedy = f"cannot be opened ({error.strerror})", "Correct its path."
        raise ConfigError(path, problem, remedy) from None
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise ConfigError(
            path, "is not text and cannot be edited", "Save it as CSV in UTF-8."
        )
    return text


def save_text(path: Path, text: str) -> None:
    """Write a text that `text_of` read, and that was edited, in the encoding of its file."""
    encoding = _encoding(path.read_bytes())
    try:
        content = text.encode(encoding)
    except UnicodeEncodeError as error:
        problem = f"is in {encoding}, which cannot have {text[error.start]!r}"
        raise ConfigError(path, problem, "Save it in UTF-8.") from None
    write_whole(path, content)


def _encoding(content: bytes) -> str:
    """UTF-16 by its mark, UTF-8, or code page 1252: as `gst.config.user_tables` reads a table."""
    marks = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
    if content[:2] in marks:
        return marks[content[:2]]
    try:
        content.decode()
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def with_values(text: str, values: Mapping[str, Any]) -> str:
    """The text of a config with values at keys such as ``scans.mould.invert``, added if absent.

    Raises a `ConfigError` if a key lies in a value that is not a section, or if the values cannot
    be written into this text.

    >>> given = "a:\\n  b: 1  # one\\n\\nc: {d: 3}\\nload:\\n"
    >>> values = {"a.b": 2, "a.e": "TODO", "c.f": "1, 2", "load.force_N": 9.0, "g.h": [1.5]}
    >>> print(with_values(given, values), end="")
    a:
      b: 2  # one
      e: TODO
    <BLANKLINE>
    c: {d: 3, f: '1, 2'}
    load: {force_N: 9.0}
    g: {h: [1.5]}
    """
    former = parse_yaml(text, _CONFIG)
    config = copy.deepcopy(former)
    for key, value in values.items():
        _set(config, key, value)
    splices = _changes(text, yaml.compose(text), former, config)
    edited = text
    # from the end, so that the places before it stay valid
    in_order = sorted(splices, key=lambda splice: splice[:2])
    for start, end, new in reversed(in_order):
        edited = f"{edited[:start]}{new}{edited[end:]}"
    if edited != text and not _is_same(parse_yaml(edited, _CONFIG), config):
        problem = f"cannot take {', '.join(values)} without a change elsewhere"
        raise ConfigError(_CONFIG, problem, "Edit it by hand.")
    return edited


def _set(config: dict, key: str, value: Any) -> None:
    """Set a value at a key with dots; sections that are absent or null are made."""
    *sections, name = key.split(".")
    for section in sections:
        if config.get(section) is None:
            config[section] = {}
        config = config[section]
        if not isinstance(config, dict):
            problem = f"lies in {section}, which is {config!r:.40} and not a section"
            raise ConfigError(key, problem, f"Correct {section} in the config.")
    config[name] = value


def _is_same(one: Any, other: Any) -> bool:
    """Whether two values are equal and of one kind: 1, 1.0 and true differ."""
    return json.dumps(one) == json.dumps(other)


def _changes(
    text: str, node: yaml.Node, former: Any, new: Any, colon: int = 0
) -> Iterator[_Splice]:
    """The changes of a text that give a node another value; it stands behind `colon`."""
    if _is_same(former, new):
        return
    if (
        isinstance(node, yaml.MappingNode)
        and isinstance(new, dict)
        and former.keys() <= new.keys()
    ):
        for key, part in node.value:
            behind = text.find(":", key.end_mark.index) + 1
            yield from _changes(text, part, former[key.value], new[key.value], behind)
        if more := {name: value for name, value in new.items() if name not in former}:
            yield _addition(text, node, more)
    elif (
        isinstance(node, yaml.SequenceNode)
        and isinstance(new, list)
        and len(former) == len(new)
    ):
        for part, one, other in zip(node.value, former, new, strict=True):
            dash = len(text[: part.start_mark.index].rstrip())
            yield from _changes(text, part, one, other, dash)
    elif _is_block(node):
        # in the line of its key, before a comment
        yield colon, colon, f" {_flow(new)}"
        yield len(text[: node.start_mark.index].rstrip()), _end(text, node), ""
    else:
        start, end = node.start_mark.index, _end(text, node)
        yield start, end, f"{' ' * (start == end)}{_flow(new)}"


def _addition(text: str, section: yaml.MappingNode, more: Mapping[str, Any]) -> _Splice:
    """The change that gives a section further keys at its end."""
    if not _is_block(section):
        pairs, at = ", ".join(_pairs(more)), section.end_mark.index - 1
        if section.value:
            pairs, at = f", {pairs}", _end(text, section.value[-1][1])
        return at, at, pairs
    end = _end(text, section)
    at = end + len([*text[end:].splitlines(), ""][0])
    start = _line_end(text) + " " * section.value[0][0].start_mark.column
    return at, at, "".join(f"{start}{pair}" for pair in _pairs(more))


def _line_end(text: str) -> str:
    return next((end for end in ("\r\n", "\n", "\r") if end in text), "\n")


def _is_block(node: yaml.Node) -> bool:
    return isinstance(node, yaml.CollectionNode) and not node.flow_style


def _end(text: str, node: yaml.Node) -> int:
    """Where a value ends in the text, without blank lines and comments behind it."""
    while _is_block(node):
        last = node.value[-1]
        node = last[1] if isinstance(node, yaml.MappingNode) else last
    start, end = node.start_mark.index, node.end_mark.index
    return start + len(text[start:end].rstrip())


def _pairs(values: Mapping[str, Any]) -> list[str]:
    return [_flow({name: value})[1:-1] for name, value in values.items()]


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

    Rows may go, and `more` come at its end. `renamed` has other names of columns. Raises a
    `ConfigError` if the table cannot be read, or has two columns of one name.

    >>> print(with_cells("# places\\npatch;x\\n1; 2,5\\n", lambda row: {"note": row["x"]}), end="")
    # places
    patch;x;note
    1; 2,5;2,5
    """
    try:
        records, mark = records_of(text.removeprefix("\ufeff"))
    except csv.Error as error:
        raise ConfigError(
            _TABLE, f"cannot be read ({error})", "Correct its quotes."
        ) from None
    rows = [record.cells for record in records if record.is_row]
    if not rows:
        return text
    names = _names(rows[0], renamed or {})
    empty = dict.fromkeys(names, "")
    former = [empty | dict(zip(names, row, strict=False)) for row in rows[1:]]
    changed = [cells(row) for row in former]
    named = dict.fromkeys(name for row in [*changed, *more] for name in row or ())
    added = [name for name in named if name not in names]
    # spreadsheets write empty cells behind the last column, which a new one takes
    width = max(n for row in rows for n, cell in enumerate(row, 1) if cell)
    columns = [*names[:width], *[""] * (width - len(names)), *added]
    decimals = {cell for row in rows for cell in row if _DECIMAL.fullmatch(cell)}
    has_commas = mark != "," and "," in "".join(decimals)

    def line_with(line: str, row: Mapping[str, str], new: Mapping[str, object]) -> str:
        changes = {}
        for name, value in (dict.fromkeys(added, "") | dict(new)).items():
            cell = str(value)
            if name in row and _plain(row[name]) == _plain(cell):
                continue
            if has_commas and _DECIMAL.fullmatch(cell):
                cell = cell.replace(".", ",")
            changes[columns.index(name)] = cell
        return _with_parts(line, changes, mark)

    edited = "\ufeff" * text.startswith("\ufeff")
    heading = {name: name for name in added}
    pairs = zip([{}, *former], [heading, *changed], strict=True)
    for record in records:
        if not record.is_row:
            edited += record.text
            continue
        row, new = next(pairs)
        if new is not None:
            edited += line_with(record.text, row, new)
    blank = dict.fromkeys(columns, "")
    lines = [line_with("", {}, blank | dict(new)) for new in more]
    return _with_lines(edited, lines, _line_end(text))


def _with_lines(text: str, lines: Sequence[str], line_end: str) -> str:
    """A text with more lines; its last line ends as before."""
    is_ended = text.endswith(("\n", "\r"))
    for line in lines:
        text += f"{line}{line_end}" if is_ended else f"{line_end}{line}"
    return text


def _names(header: Sequence[str], renamed: Mapping[str, str]) -> list[str]:
    """The names of a table's columns, as `gst.config.user_tables` recognises them."""
    names = [alike(name) for name in header]
    names = [
        renamed[n] if n in renamed and renamed[n] not in names else n for n in names
    ]
    if twice := [name for name in names if name and names.count(name) > 1]:
        problem = f"has two columns named {twice[0]!r}"
        raise ConfigError(_TABLE, problem, "Remove or rename one of them.")
    return names


def _plain(cell: str) -> str:
    """A cell; a number with decimals without its last zeros, and with a point."""
    is_decimal = _DECIMAL.fullmatch(cell)
    return cell.replace(",", ".").rstrip("0").rstrip(".") if is_decimal else cell


def _with_parts(line: str, cells: Mapping[int, str], mark: str) -> str:
    """A row's text with other cells, by their number; blanks and quotes of all others stay."""
    if not cells:
        return line
    body = line.rstrip("\r\n")
    parts = re.findall(rf'(?:\A|{mark})("(?:[^"]|"")*"|[^{mark}]*)', body)
    parts += [""] * (max(cells) + 1 - len(parts))
    for number, cell in cells.items():
        written = io.StringIO()
        csv.writer(
            written,
            delimiter=mark,
            quoting=csv.QUOTE_NONNUMERIC if body.startswith('"') else csv.QUOTE_MINIMAL,
        ).writerow([cell, 0])
        parts[number] = written.getvalue().removesuffix(f"{mark}0\r\n")
    return mark.join(parts) + line[len(body) :]
