"""The application around `gstlib`: the command `gst`, config, checks, runs, page and figures.

It reads configs and files, runs the workflow and shows its results. The physics is in
`gstlib`, which does not depend on it.
"""

import os
import sys

# `python -m gst` puts the working folder first on Python's path. It may be that of a study from
# somebody else, whose files are no modules.
if sys.argv[:1] == ["-m"] and sys.path[0] == os.getcwd() and not sys.flags.safe_path:
    del sys.path[0]

from pathlib import Path

# The folder of Snakefile, workflow, config and profiles: in the package once it is installed,
# or beside `src` in a clone of the project.
_INSTALLED = Path(__file__).parent / "shipped"
ROOT = _INSTALLED if _INSTALLED.is_dir() else Path(__file__).parents[2]

# The configs that come with it, by name; whatever else lies in its folder `config` is a user's.
SHIPPED = (
    "config",
    "artefact",
    "m12",
    "interlayer",
    "mesh_only",
    "own",
    "pebble",
    "tiny",
    "two_tools",
)

# Scans' holes are filled over triangles of three points each. Where other work runs, threads of the
# linear algebra wait for each other so long that this takes ten times the CPU; nothing here gains
# from them. Snakemake gives the step that has the machine to itself as many as there are cores.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
