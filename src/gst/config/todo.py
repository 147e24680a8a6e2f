"""Values that `gst new` could not infer from the files, which begin with `TODO`.

A likely value may follow the word; whoever deletes the word confirms it. Nothing runs while one is
left.
"""

from typing import Any

TODO = "TODO"


def is_to_do(value: Any) -> bool:
    """Whether a value is still to be given or confirmed."""
    return isinstance(value, str) and value.startswith(TODO)


def sentence(what: str, value: str, description: str) -> str:
    """The task that a value leaves to the user, and the meaning of the value."""
    likely = value.removeprefix(TODO).strip()
    text = f"{what} is still {TODO}: fill it in"
    if likely:
        text = f"{what} is still '{value}': delete the word {TODO} if {likely} is right"
    return f"{text} [{description}]" if description else text
