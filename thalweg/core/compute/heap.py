"""Memory that was freed is kept in the process, for what is allocated next.

glibc returns each block of more than 32 MiB to the kernel, and the end of its heap. The kernel clears each page of such
a block when it is next written to, which takes longer than writing it: a batch of 128 images as floats, 34 MB, is
allocated and freed for each gradient step.
"""

import ctypes
import sys

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's mallopt, see malloc.h."""
LARGEST_KEPT_BYTES = 1 << 30
"""Blocks up to this size, and as much at the end of the heap, are kept."""


def keep_freed_memory() -> bool:
    """Keep freed blocks of up to `LARGEST_KEPT_BYTES` from now on; returns whether the C library does.

    It holds for the whole process. Libraries other than glibc are left as they are.
    """
    if not sys.platform.startswith("linux"):
        return False
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # musl has none
    if mallopt is None:
        return False
    return bool(mallopt(M_MMAP_THRESHOLD, LARGEST_KEPT_BYTES) and mallopt(M_TRIM_THRESHOLD, LARGEST_KEPT_BYTES))
