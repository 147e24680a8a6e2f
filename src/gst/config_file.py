"""Reads a config file, or says in one sentence why it cannot."""

from pathlib import Path

import yaml

from gstlib.errors import ConfigError
from gstlib.io.files import check_size

__all__ = ["read_config_file"]

# Bytes of a config, twenty times those of the longest shipped one; and its values, each counted
# as often as aliases repeat it.
_LARGEST, _MOST_VALUES = 100_000, 100_000


def read_config_file(path: str | Path) -> dict:
    """The keys and values of a YAML file in UTF-8, nested as in the file, without defaults.

    Raises
    ------
    ConfigError
        The file cannot be opened, is not UTF-8 or not YAML, or holds no keys with values.
    """
    try:
        check_size(path, _LARGEST)
        text = Path(path).read_text(encoding="utf-8")
        _refuse_many_aliases(path, yaml.compose(text, yaml.SafeLoader))
        config = yaml.safe_load(text)
    except OSError as error:
        remedy = "Correct its path, or make one with `gst new`."
        raise ConfigError(path, f"cannot be opened ({error.strerror})", remedy) from None
    except RecursionError:
        remedy = "Indent its keys as in config/config.yaml."
        raise ConfigError(path, "nests lists or keys too deeply", remedy) from None
    except (ValueError, yaml.YAMLError) as error:  # also of a date or number that is none
        raise ConfigError(
            path,
            f"is not YAML in UTF-8: {' '.join(str(error).split())}",
            "Correct that line, or the one before it: put text with a colon in quotes, "
            "and indent lines with spaces, not tabs.",
        ) from None
    if not isinstance(config, dict):
        problem = f"holds {config!r:.40}, not keys with values"
        raise ConfigError(
            path, problem, "Write one 'key: value' per line, as in config/config.yaml."
        )
    return config


def _refuse_many_aliases(path: str | Path, root: yaml.Node | None) -> None:
    """Refuse a few lines whose aliases (``*name``) stand for more values than memory holds."""
    counted: dict[int, int] = {}

    def values(node: yaml.Node) -> int:
        if id(node) not in counted:
            counted[id(node)] = _MOST_VALUES  # an alias within its own value never ends
            parts = node.value if isinstance(node, yaml.CollectionNode) else []
            pairs = (part if isinstance(part, tuple) else (part,) for part in parts)
            counted[id(node)] = 1 + sum(values(one) for pair in pairs for one in pair)
        return counted[id(node)]

    if root is not None and (count := values(root)) > _MOST_VALUES:
        problem = f"repeats values by aliases (*) until there are {count:.3g}"
        raise ConfigError(path, problem, "Write each value once, without aliases.")
