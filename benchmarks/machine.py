"""What the figures were measured on: machine.json."""

import os
import platform
import re
import subprocess
import time
from importlib.metadata import version

from environments import version_of


def describe(codes):
    """Processor, cores, memory, system and versions."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "date": time.strftime("%Y-%m-%d"),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_gib": round(memory / 2**30, 1),
        "system": platform.platform(),
        "codes": {code: version_of(code) for code in codes},
        "gstlib_with": {name: version(name) for name in ("numpy", "ducc0")},
    }


def _processor():
    """Name, family and model: a virtual machine's name alone may say little."""
    listed = subprocess.check_output(["lscpu"], text=True, env={"LC_ALL": "C"})
    parts = dict(re.findall(r"^ *([^:]+): *(.*)$", listed, re.MULTILINE))
    names = {"Model name": "", "CPU family": "family ", "Model": "model "}
    names["L3 cache"] = "L3 "
    return ", ".join(names[key] + parts[key] for key in names if key in parts)
