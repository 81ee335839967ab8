"""What glibc keeps of the memory that arrays give back: to ask for it anew takes a twentieth of a short command.  Other systems do not care."""

from __future__ import annotations

import os

THRESHOLDS = {"MALLOC_MMAP_THRESHOLD_": 2**25, "MALLOC_TRIM_THRESHOLD_": 2**27}
"""Variables that set it for a process to be started, bytes: from where on an array is given back at once, and how much free memory is."""

_OPTIONS = {"MALLOC_MMAP_THRESHOLD_": -3, "MALLOC_TRIM_THRESHOLD_": -1}  # malloc.h


def keep_memory() -> None:
    """Sets it for this process, but for what the environment sets."""
    try:
        from ctypes import CDLL

        mallopt = CDLL(None).mallopt
    except (ImportError, OSError, AttributeError, TypeError):  # not glibc
        return
    for name, size in THRESHOLDS.items():
        if name not in os.environ:
            mallopt(_OPTIONS[name], size)
