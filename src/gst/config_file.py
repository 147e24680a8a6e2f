"""Reads a config file, or says in one sentence why it cannot."""

from pathlib import Path

import yaml

from gstlib.errors import ConfigError

__all__ = ["read_config_file"]


def read_config_file(path: str | Path) -> dict:
    """The keys and values of a YAML file in UTF-8, nested as in the file, without defaults.

    Raises
    ------
    ConfigError
        The file cannot be opened, is not UTF-8 or not YAML, or holds no keys with values.
    """
    try:
        config = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        remedy = "Correct its path, or make one with `gst new`."
        raise ConfigError(path, f"cannot be opened ({error.strerror})", remedy) from None
    except (UnicodeDecodeError, yaml.YAMLError) as error:
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
