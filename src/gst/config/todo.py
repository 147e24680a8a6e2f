"""Values that `gst new` could not infer from the files, which begin with `TODO`.

A likely value may follow the word; whoever deletes the word confirms it. Nothing runs while one is
left.
"""

from collections.abc import Iterator, Mapping
from typing import Any

TODO = "TODO"


def is_to_do(value: Any) -> bool:
    """Whether a value is still to be given or confirmed."""
    return isinstance(value, str) and value.startswith(TODO)


def left_in(config: Any, rule: Mapping, key: str = "") -> Iterator[str]:
    """A sentence for each value that is left in a config; `rule` is the schema's."""
    if isinstance(config, Mapping):
        rules = rule.get("properties", {})
        for name, value in config.items():
            full = f"{key}.{name}" if key else str(name)
            yield from left_in(value, rules.get(name, {}), full)
    elif is_to_do(config):
        yield sentence(f"'{key}'", config, rule.get("description", ""))


def sentence(what: str, value: str, description: str) -> str:
    """The task that a value leaves to the user, and the meaning of the value."""
    likely = value.removeprefix(TODO).strip()
    text = f"{what} is still {TODO}: fill it in"
    if likely:
        text = f"{what} is still '{value}': delete the word {TODO} if {likely} is right"
    return f"{text} [{description}]" if description else text
