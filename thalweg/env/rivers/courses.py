"""Joining the course arrays of single worlds, so that one world can be replaced without packing the others again."""

from collections.abc import Sequence

import numpy as np

from thalweg.env.task.course_arrays import CourseArrays

OFFSETS = (
    "first_sample", "first_island", "first_bridge", "first_plane", "first_haunt", "first_reserve", "first_buoy",
)  # fmt: skip
"""Fields that hold the first row of each world, or of each bridge, and the end of the last."""


def join_courses(parts: Sequence[CourseArrays]) -> CourseArrays:
    """Return the course arrays of the worlds of all parts, in order; equal to packing these worlds together."""
    joined = {}
    for name in CourseArrays._fields:
        arrays = [getattr(part, name) for part in parts]
        joined[name] = _join_offsets(arrays) if name in OFFSETS else np.concatenate(arrays)
    return CourseArrays(**joined)


def _join_offsets(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Return offsets over the rows of all parts, from those [W + 1] of each."""
    ends = np.cumsum([0, *(array[-1] for array in arrays[:-1])])
    begun = [array[:-1] + end for array, end in zip(arrays, ends, strict=True)]
    return np.concatenate([*begun, [arrays[-1][-1] + ends[-1]]]).astype(np.int64)
