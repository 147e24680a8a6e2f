"""Bounds on the memory and the time that a reader may take for a file.

A damaged or hostile file can announce sizes that it does not have, or a structure that takes ages
to walk through. Nothing is known beforehand of every reader, so the whole process is bounded while
one runs: its address space (Linux, where the present size can be read) and the clock (POSIX, in the
main thread). Elsewhere the readers' own checks have to do.
"""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gstlib.errors import InputError

try:
    import resource
except ImportError:  # no such limits on Windows
    resource = None

__all__ = ["LARGEST_FILE", "bounded"]

# Bytes of a file, and of what is packed in it: an 8192 × 8192 map with colours has 0.5 GB.
LARGEST_FILE = 1 << 30
# A number takes 2 bytes of text at least and, as Python object in a list, about 100 bytes.
_MEMORY_FLOOR, _MEMORY_PER_BYTE = 512 << 20, 64
# Seconds; the slowest reader (of text, in Python) takes 0.5 s a megabyte.
_TIME_FLOOR, _TIME_PER_BYTE, _AGAIN = 60.0, 5e-6, 0.5

_DAMAGED = "It is damaged, or not what its name says: export or copy the scan again."

# Limits of the process are one at a time.
_one_reader = threading.RLock()


class _OutOfTime(BaseException):
    """Not an Exception, which the readers would take for their own and go on."""


@contextmanager
def bounded(path: Path, size: int) -> Iterator[None]:
    """Refuse a file whose reading, in the block, takes more than its size warrants.

    At most 512 MiB and 64 times `size` of memory are taken beyond what the process has, and 60 s
    and 5 s a megabyte of `size`.

    Parameters
    ----------
    path : Path
        The file, for the message.
    size : int
        Its bytes, unpacked.

    Raises
    ------
    InputError
        A bound was reached; the limits of the process are as before.
    """
    memory = _MEMORY_FLOOR + _MEMORY_PER_BYTE * size
    seconds = _TIME_FLOOR + _TIME_PER_BYTE * size
    try:
        with _one_reader, _less_memory(memory), _less_time(seconds):
            yield
    except MemoryError as error:
        raise InputError(
            path, f"its {size} bytes take more than {memory >> 20} MiB to read", _DAMAGED
        ) from error
    except _OutOfTime as error:
        raise InputError(
            path, f"its {size} bytes take more than {seconds:.0f} s to read", _DAMAGED
        ) from error


@contextmanager
def _less_memory(allowed: int) -> Iterator[None]:
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except (OSError, ValueError):
        pages = 0
    if not pages or resource is None:
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + allowed
    for other in (soft, hard):
        if other != resource.RLIM_INFINITY:
            limit = min(limit, other)
    resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@contextmanager
def _less_time(allowed: float) -> Iterator[None]:
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or not hasattr(signal, "setitimer"):
        yield
        return

    def stop(*_):
        raise _OutOfTime

    start = time.monotonic()
    # Again and again: what is raised while Python cleans up an object is lost. The timer before
    # the handler: an alarm that somebody else has set must not reach ours.
    remaining, interval = signal.setitimer(signal.ITIMER_REAL, allowed, _AGAIN)
    handler = signal.signal(signal.SIGALRM, stop)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)
        if remaining:  # somebody else's alarm, which goes on
            left = max(remaining - (time.monotonic() - start), 1e-3)
            signal.setitimer(signal.ITIMER_REAL, left, interval)
