"""The application around `gstlib`: the command `gst`, config, checks, runs, page and figures.

It reads configs and files, runs the workflow and shows what came out. The physics is in `gstlib`,
which knows nothing of it.
"""

from pathlib import Path

__all__ = ["ROOT"]

# Where Snakefile, workflow, config and profiles are: in the package once it is installed, beside
# `src` in a clone of the project.
_INSTALLED = Path(__file__).parent / "shipped"
ROOT = _INSTALLED if _INSTALLED.is_dir() else Path(__file__).parents[2]
