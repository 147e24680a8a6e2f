"""What the figures were measured on: machine.json."""

import os
import platform
import subprocess
import time

from environments import ENVIRONMENTS, UnavailableError


def describe(environments):
    """Processor, cores, memory, system and versions."""
    libraries = {}
    for name in environments:
        try:
            ENVIRONMENTS[name].interpreter()
            libraries[name] = ENVIRONMENTS[name].version()
        except UnavailableError as problem:
            libraries[name] = f"not available ({problem})"
    from importlib.metadata import version

    return {
        "date": time.strftime("%Y-%m-%d"),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_gib": round(
            os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1
        ),
        "system": platform.platform(),
        "compiler": _first_line("c++", "--version"),
        "codes": libraries,
        "gstlib_with": {name: version(name) for name in ("numpy", "ducc0")},
        "load_average_at_start": round(os.getloadavg()[0], 2),
    }


def _processor():
    """Name, family and model: a virtual machine's name alone may say little."""
    wanted = {"model name": "", "cpu family": "family ", "model": "model "}
    parts = {}
    with open("/proc/cpuinfo", encoding="ascii", errors="replace") as file:
        for line in file:
            key, _, value = (part.strip() for part in line.partition(":"))
            if key in wanted and key not in parts:
                parts[key] = wanted[key] + value
    cache = _first_line("getconf", "LEVEL3_CACHE_SIZE")
    level3 = (
        [f"L3 {int(cache) / 2**20:.0f} MiB"] if cache.isdigit() and int(cache) else []
    )
    return ", ".join([*(parts[key] for key in wanted if key in parts), *level3])


def _first_line(*command):
    try:
        done = subprocess.run(command, capture_output=True, text=True)
    except FileNotFoundError:
        return "none"
    return (done.stdout.splitlines() or [""])[0]
