"""A config or a table with other values, in which all else stays as it was, byte for byte.

PyYAML and `csv` read the text, and it is changed only at the values that they found. A list and a
row of a table are written anew as a whole. The round trip of ruamel.yaml is no substitute: it
alters blanks, indents and nulls elsewhere, even in most of the shipped configs, and it does not
show where the value of an empty key belongs.
"""

import csv
import io
import itertools
import json
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import yaml

from gst.config.strict_yaml import as_yaml, parse_yaml
from gst.config.user_tables import Record, column_names, encoding_of, records_of
from gstlib.errors import ConfigError
from gstlib.io.files import write_whole

# Of a row's cells, by column, those that change; None if the row goes.
Cells: TypeAlias = Callable[[Mapping[str, str]], Mapping[str, object] | None]

_CONFIG, _TABLE = "the config", "the patch table"
_ABSENT = object()
_DECIMAL = re.compile(r"[-+]?\d*[.,]\d+")


def text_of(path: Path) -> str:
    """The text of a config or a table, with its line ends and its byte order mark.

    Raises a `ConfigError` if the file cannot be opened, or is not text.
    """
    try:
        content = path.read_bytes()
        text = content.decode(encoding_of(content))
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
    encoding = encoding_of(path.read_bytes())
    try:
        content = text.encode(encoding)
    except UnicodeEncodeError as error:
        problem = f"is in {encoding}, which cannot have {text[error.start]!r}"
        raise ConfigError(path, problem, "Save it in UTF-8.") from None
    write_whole(path, content)


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
    config = parse_yaml(text, _CONFIG)
    edited = text
    for key, value in values.items():
        if not _is_same(_set(config, key.split("."), value), value):
            root = yaml.compose(edited)
            edited = _with_value(edited, root, key.split("."), value)
    if edited != text and not _is_same(parse_yaml(edited, _CONFIG), config):
        problem = f"cannot take {', '.join(values)} without a change elsewhere"
        raise ConfigError(_CONFIG, problem, "Edit it by hand.")
    return edited


def _set(config: dict, names: Sequence[str], value: Any) -> Any:
    """Set a value, make sections that are absent or null, and return the former value."""
    *sections, last = names
    for section in sections:
        if config.get(section) is None:
            config[section] = {}
        config = config[section]
        if not isinstance(config, dict):
            problem = f"lies in {section}, which is {config!r:.40} and not a section"
            remedy = f"Correct {section} in the config."
            raise ConfigError(".".join(names), problem, remedy)
    former = config.get(last, _ABSENT)
    config[last] = value
    return former


def _is_same(one: Any, other: Any) -> bool:
    """Whether two values are equal and of one kind: 1, 1.0 and true differ."""
    return json.dumps(one, default=repr) == json.dumps(other, default=repr)


def _with_value(
    text: str, section: yaml.MappingNode, names: Sequence[str], value: Any
) -> str:
    """The text with a value at a key within a section, which is replaced or added."""
    for key, node in section.value:
        if key.value == names[0]:
            if names[1:] and isinstance(node, yaml.MappingNode) and node.value:
                return _with_value(text, node, names[1:], value)
            return _replaced(text, key, node, _flow(_nested(names[1:], value)))
    pair = _flow(_nested(names, value))[1:-1]
    end = _end(text, section)
    if section.flow_style:
        last = _end(text, section.value[-1][1]) if section.value else end - 1
        return f"{text[:last]}{', ' * bool(section.value)}{pair}{text[last:]}"
    end += len([*text[end:].splitlines(), ""][0])
    indent = " " * section.value[0][0].start_mark.column
    return f"{text[:end]}{_line_end(text)}{indent}{pair}{text[end:]}"


def _replaced(text: str, key: yaml.Node, node: yaml.Node, new: str) -> str:
    start, end = node.start_mark.index, _end(text, node)
    if not _is_block(node):
        return f"{text[:start]}{' ' * (start == end)}{new}{text[end:]}"
    # in the line of its key, before a comment
    colon = text.index(":", key.end_mark.index) + 1
    return f"{text[:colon]} {new}{text[colon:start].rstrip()}{text[end:]}"


def _nested(names: Sequence[str], value: Any) -> Any:
    for name in reversed(names):
        value = {name: value}
    return value


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


def _flow(value: Any) -> str:
    """A value in one line of YAML."""
    # within a list, as what stands in a section of one line has to be quoted
    written = as_yaml([value], default_flow_style=True, width=1 << 20)
    return written.removesuffix("\n")[1:-1]


def with_cells(
    text: str, cells: Cells, more: Collection[Mapping[str, object]] = ()
) -> str:
    """The text of a table with some cells of its rows changed, and columns added where absent.

    Rows may go, and `more` come at its end. Raises a `ConfigError` if the table cannot be read, or
    has two columns of one name.

    >>> print(with_cells("# places\\npatch;x\\n1; 2,5\\n", lambda row: {"note": row["x"]}), end="")
    # places
    patch;x;note
    1;2,5;2,5
    """
    try:
        records, mark = records_of(text.removeprefix("\ufeff"))
    except csv.Error as error:
        problem = f"cannot be read ({error})"
        raise ConfigError(_TABLE, problem, "Correct its quotes.") from None
    rows = [record.cells for record in records if record.is_row]
    if not rows:
        return text
    names = column_names(_TABLE, rows[0])
    changes = [
        cells(dict(itertools.zip_longest(names, row[: len(names)], fillvalue="")))
        for row in rows[1:]
    ]
    named = dict.fromkeys(name for row in [*changes, *more] for name in row or ())
    added = [name for name in named if name not in names]
    width = max(map(len, rows))
    if added:
        # spreadsheets write empty cells behind the last column, which a new one takes
        width = max(n for row in rows for n, cell in enumerate(row, 1) if cell)
    columns = [*names, *[""] * width][:width] + added
    decimals = {cell for row in rows for cell in row if _DECIMAL.fullmatch(cell)}
    has_commas = mark != "," and "," in "".join(decimals)

    def line_with(record: Record, new: Mapping[str, object]) -> str:
        former = [*record.cells, *[""] * width][:width]
        row = former + [""] * len(added)
        for name, value in new.items():
            cell, at = str(value), columns.index(name)
            if _plain(cell) != _plain(row[at]):
                is_local = has_commas and _DECIMAL.fullmatch(cell)
                row[at] = cell.replace(".", ",") if is_local else cell
        if row == former:
            return record.text
        return _line(row, record.text, mark)

    edited = "\ufeff" * text.startswith("\ufeff")
    new_cells = iter([{name: name for name in added}, *changes])
    for record in records:
        new = next(new_cells) if record.is_row else {}
        if new is not None:
            edited += line_with(record, new) if record.is_row else record.text
    lines = [line_with(Record("", [], 0), row) for row in more]
    return _with_lines(edited, lines, _line_end(text))


def _line(row: Sequence[str], former: str, mark: str) -> str:
    """The text of a row, with the line end and the quotes of its former text."""
    line = io.StringIO()
    writer = csv.writer(
        line,
        delimiter=mark,
        quoting=csv.QUOTE_ALL if former.startswith('"') else csv.QUOTE_MINIMAL,
        lineterminator=former[len(former.rstrip("\r\n")) :],
    )
    writer.writerow(row)
    return line.getvalue()


def _with_lines(text: str, lines: Sequence[str], line_end: str) -> str:
    """A text with more lines; its last line ends as before."""
    is_ended = text.endswith(("\n", "\r"))
    for line in lines:
        text += f"{line}{line_end}" if is_ended else f"{line_end}{line}"
    return text


def _plain(cell: str) -> str:
    """A cell; a number with decimals without its last zeros, and with a point."""
    is_decimal = _DECIMAL.fullmatch(cell)
    return cell.replace(",", ".").rstrip("0").rstrip(".") if is_decimal else cell
