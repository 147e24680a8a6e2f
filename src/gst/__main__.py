"""The command `gst`, also as ``python -m gst``."""

import sys


def run() -> None:
    """Run the command, or say which extra it needs."""
    try:
        from gst.cli import main
    except ImportError as error:
        remedy = "Install it: pip install 'gstlib[workflow]'"
        sys.exit(f"ERROR: gst: {error.name} is not installed. {remedy}")
    main()


if __name__ == "__main__":
    run()
