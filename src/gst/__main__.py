"""The command `gst`, also as ``python -m gst``."""

import os
import sys

# The many tiny matrices of an interpolation are slower on several threads, up to eight times.
# Snakemake gives each job threads of its own. Set before NumPy is imported, which reads it once.
_THREADS = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"


def run() -> None:
    """Run the command, or say which extra it needs."""
    for name in _THREADS:
        os.environ.setdefault(name, "1")
    try:
        from gst.cli import main
    except ImportError as error:
        remedy = "Install it: pip install 'gstlib[workflow]'"
        print(f"ERROR: gst: {error.name} is not installed. {remedy}", file=sys.stderr)
        sys.exit(2)
    main()


if __name__ == "__main__":
    run()
