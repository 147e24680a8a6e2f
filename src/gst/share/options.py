"""Messages of the library for the user of a command that has options, and no config."""

import re

# Parts of a message, and their form for a user of `gst inspect`, `press` or `change`.
_MEANT = {
    r"scans\.unit( in the config)?|mesh_unit:": "--unit",
    r"scans\.spacing_um( in the config)?": "--spacing-um",
    r"Lower the heights .*? repeat itself \(periodic=True\)": (
        "Give --periodic if it repeats itself. Otherwise it is pressed as if it ended there"
    ),
    r", leave it out of the patch table, or raise \S+ in the config": "",
    r" in the patch table, or the folder": "",
    r", or leave repeat empty in the patch table": ", or leave --repeat out",
    r"are heights and spacing in mm": "are the units of heights and spacing right",
    r" If the input is right, write accept: \[\w+\] in the config\.": "",
    r"\bthe whole patch\b": "the whole surface",
    r"\bpatch (?=[^:\n]+\.\w+[,:])": "",
}


def in_options(message: str) -> str:
    """A message with options in place of keys of a config, and of columns of a patch table."""
    for pattern, meant in _MEANT.items():
        message = re.sub(pattern, meant, message)
    return message
