"""A config file as text: what YAML makes of it, or why it makes nothing of it."""

from pathlib import Path

import yaml

from gstlib.errors import ConfigError

__all__ = ["read_config_file"]


def read_config_file(path: str | Path) -> dict:
    """The keys and values of a config file, as they stand in it.

    Parameters
    ----------
    path : str or Path
        A YAML file in UTF-8.

    Returns
    -------
    dict
        As nested as the file is.

    Raises
    ------
    ConfigError
        The file cannot be opened, is not UTF-8 or not YAML, or holds no keys with values.
    """
    try:
        config = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(
            path,
            "no such file",
            "Correct CONFIG=...; the path is relative to the working folder.",
        ) from None
    except OSError as error:
        raise ConfigError(
            path,
            f"cannot be opened ({error.strerror})",
            "Give the path of a config file that you may read.",
        ) from None
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        line = error.object.count(b"\n", 0, error.start) + 1
        raise ConfigError(
            path,
            f"is not UTF-8 text: byte {byte:#04x} in line {line}",
            "Save it as UTF-8 in your editor.",
        ) from None
    except yaml.YAMLError as error:
        raise ConfigError(
            path,
            f"is not YAML: {_place(error)}",
            "Correct that line, or the one before it: text with a colon in it stands in quotes, "
            "and lines are indented with spaces, not tabs.",
        ) from None
    if not isinstance(config, dict):
        held = {type(None): "nothing", list: "a list"}.get(type(config), f"only {config!r:.40}")
        raise ConfigError(
            path,
            f"holds {held}, not keys with values",
            "Write one 'key: value' a line, as in config/config.yaml.",
        )
    return config


def _place(error: yaml.YAMLError) -> str:
    """The line at fault and what YAML says of it, on one line."""
    mark = getattr(error, "problem_mark", None)
    if mark is None:
        return " ".join(str(error).split())
    snippet = (mark.get_snippet(indent=0) or "").splitlines()
    shown = f", {snippet[0].strip()!r}" if snippet else ""
    return f"line {mark.line + 1}{shown}: {error.problem}"
