"""A config with other values, and its comments and layout as they were.

No library at hand writes YAML back with its comments. PyYAML says where in the text each value
stands, and only there it is changed.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

__all__ = ["with_values"]


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
