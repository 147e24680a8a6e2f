"""YAML that every program reads alike: the only YAML that a study accepts from its user.

PyYAML follows YAML 1.1 and Snakemake uses it: ``0550`` is 360 there, ``9:10`` is 550, ``no`` is
false, ``1e3`` is text, and of a key given twice the last value wins in silence. Other programs
follow YAML 1.2 and read other values. This module reads plain decimal numbers, ``true``, ``false``
and null; it refuses each other spelling that some program takes for a number or a truth value.

PyYAML with these rules is preferred to ruamel.yaml. The latter follows YAML 1.2 and refuses a key
given twice, but it also accepts ``0550`` and ``1_000``, so that the same checks would be needed.
"""

import re
import unicodedata
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import yaml

from gstlib.errors import ConfigError
from gstlib.io.files import check_size

# Bytes of a file, twenty times those of the longest shipped config.
_LARGEST = 100_000
# Levels of lists and sections in each other, three times those of any key. PyYAML's time grows with
# their square.
_DEEPEST = 20
# Lines in a message; who has corrected them is shown the next ones.
_MOST_LISTED = 20
_REMEDY = "See config/README.md for all keys."
_TAG = "tag:yaml.org,2002:"
_DOUBTFUL_NUMBER, _DOUBTFUL_TRUTH = "!number", "!truth"
# The first pattern that fits decides; a plain scalar that fits none is text.
_SCALARS = {
    f"{_TAG}null": r"~|null|Null|NULL|",
    f"{_TAG}bool": r"true|True|TRUE|false|False|FALSE",
    f"{_TAG}int": r"[-+]?(0|[1-9][0-9]*)",
    _DOUBTFUL_TRUTH: r"yes|Yes|YES|no|No|NO|on|On|ON|off|Off|OFF",
    # octal, with a base, with underscores, to the base 60, without end, in digits of other scripts
    _DOUBTFUL_NUMBER: (
        r"[-+]?0[0-9]+"
        r"|[-+]?0[xXoObB][0-9a-fA-F_]+"
        r"|[-+]?(?=\S*_)\.?[0-9][0-9._]*([eE][-+]?[0-9]+)?"
        r"|[-+]?[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?"
        r"|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
        r"|(?=\S*[^\x00-\x7f])[-+−]?\.?\d[\d.,_]*([eE][-+−]?\d+)?"
    ),
    f"{_TAG}float": r"[-+]?([0-9]++\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?",
}
_REMEDIES = {
    _DOUBTFUL_NUMBER: "write a decimal number such as 550 or 5.5e2, or put text in quotes",
    _DOUBTFUL_TRUTH: "write true or false, or put text in quotes",
}


class _Loader(yaml.SafeLoader):
    """Refuses constructs that no config needs, and that hide the meaning."""

    yaml_implicit_resolvers: ClassVar[dict] = {
        None: [(tag, re.compile(rf"(?:{form})\Z")) for tag, form in _SCALARS.items()]
    }
    depth = 0

    def compose_node(self, parent: Any, index: Any) -> yaml.Node:
        event, problem = self.peek_event(), ""
        if isinstance(event, yaml.AliasEvent):
            # a few lines of aliases can stand for more values than memory holds
            problem = (
                "repeats a value by an alias (*): write each value where it belongs"
            )
        elif event.tag:
            problem = f"has the tag {event.tag}: write the value without it"
        elif self.depth > _DEEPEST:
            problem = (
                f"is nested more than {_DEEPEST} deep: write each list in its own key"
            )
        if problem:
            line = event.start_mark.line + 1
            raise ConfigError(self.name, f"line {line}: {problem}", _REMEDY)
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


class _Dumper(yaml.SafeDumper):
    """Puts text in quotes that these rules or those of YAML 1.1 take for something else."""

    yaml_implicit_resolvers: ClassVar[dict] = (
        yaml.SafeDumper.yaml_implicit_resolvers | _Loader.yaml_implicit_resolvers
    )


def read_yaml(path: str | Path, remedy: str = "Correct its path.") -> dict:
    """The keys and values of a YAML file in UTF-8, nested as in the file.

    Raises a `ConfigError` if the file cannot be opened, which has this `remedy`; or as
    `parse_yaml` does.
    """
    try:
        check_size(path, _LARGEST)
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(
            path, f"cannot be opened ({error.strerror})", remedy
        ) from None
    except UnicodeDecodeError as error:
        raise _not_yaml(path, error) from None
    return parse_yaml(text, path)


def parse_yaml(text: str, source: str | Path) -> dict:
    """The keys and values of a text, which messages call `source`.

    Raises a `ConfigError` if it is not YAML; has no keys; repeats a key, whatever its case; has an
    alias, a tag or a second document; or if programs read one of its values differently.
    """
    try:
        loader = _Loader(text)
        loader.name = str(source)
        node = loader.get_single_node()
        doubts = [*islice(_doubts(node), _MOST_LISTED)] if node else []
        values = None if doubts or not node else loader.construct_document(node)
    # also of a number with too many digits, or of lists in lists without end
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        raise _not_yaml(source, error) from None
    if doubts:
        lines = [f"line {line}: {doubt}" for line, doubt in doubts]
        listed = "".join(f"\n  - {line}" for line in lines)
        problem = f"has lines that cannot be used{listed}\n " if lines[1:] else lines[0]
        raise ConfigError(source, problem, _REMEDY)
    if not isinstance(values, dict):
        problem = f"holds {values!r:.40}, not keys with values"
        remedy = "Write one 'key: value' per line, as in config/config.yaml."
        raise ConfigError(source, problem, remedy)
    return values


def as_yaml(value: Any, **layout: Any) -> str:
    """A value as YAML that `parse_yaml` and PyYAML read back; `layout` is for `yaml.dump`."""
    layout = {"sort_keys": False, "allow_unicode": True} | layout
    text: str = yaml.dump(value, Dumper=_Dumper, **layout)
    return text


def _not_yaml(source: str | Path, error: Exception) -> ConfigError:
    problem = f"is not YAML in UTF-8: {' '.join(str(error).split())}"
    remedy = (
        "Correct that line, or the one before it: put text with a colon in quotes, indent lines "
        "with spaces, not tabs, and write one document a file."
    )
    return ConfigError(source, problem, remedy)


def _doubts(node: yaml.Node, key: str = "") -> Iterator[tuple[int, str]]:
    """Line, key, value and remedy of all that programs read differently."""
    if isinstance(node, yaml.SequenceNode):
        for number, part in enumerate(node.value):
            yield from _doubts(part, f"{key}.{number}")
    elif isinstance(node, yaml.MappingNode):
        yield from _doubtful_keys(node, key)
        for name, part in node.value:
            yield from _doubts(part, f"{key}.{name.value}" if key else str(name.value))
    elif node.tag in _REMEDIES:
        problem = f"{key} is {node.value}, which programs read differently"
        yield node.start_mark.line + 1, f"{problem}: {_REMEDIES[node.tag]}"


def _doubtful_keys(node: yaml.MappingNode, section: str) -> Iterator[tuple[int, str]]:
    """Keys that are no names, and those that are given again, perhaps in other characters."""
    lines: dict[str, int] = {}
    for name, _ in node.value:
        line = name.start_mark.line + 1
        full = f"{section}.{name.value}" if section else str(name.value)
        if name.tag != f"{_TAG}str" or name.value == "<<":
            yield (
                line,
                f"the key {full:.60} is not a name: write names, and decimal points",
            )
            continue
        alike = unicodedata.normalize("NFKC", name.value).casefold()
        if alike in lines:
            yield (
                line,
                f"{full} is given in line {lines[alike]}, too: remove one of them",
            )
        lines.setdefault(alike, line)
