"""Fast exp, log and floor for the arithmetic of pixels: bit tricks and short polynomials, which LLVM vectorises.

Tests check that the errors of `exp` and `log2` are within those that their docstrings name; neither is for positions or
geometry. `floor` is exact. NumPy's does not exist on a GPU, and Python's gives a 64-bit integer, which does not
vectorise.
"""

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel

f32 = np.float32


@kernel(inlined=True, allocates=False)
def floor(x):
    """Return the largest whole number not above x, for x in -2e9..2e9."""
    # Conversion rounds towards zero, which is one too high below zero.
    truncated = f32(int32(x))
    return truncated - f32(1) if x < truncated else truncated


@kernel(inlined=True, allocates=False)
def log2(x):
    """Return the binary logarithm of x > 0, within 0.009."""
    # The exponent's bits are the whole part; the mantissa, read as a number in 1..2, gives the rest by a parabola.
    bits = np.float32(x).view(np.int32)
    exponent = f32((bits >> int32(23)) - int32(127))
    mantissa = np.int32((bits & int32(0x7FFFFF)) | int32(0x3F800000)).view(np.float32)
    part = mantissa - f32(1)
    return exponent + part * (f32(1.3465557) - f32(0.34484843) * part)


@kernel(inlined=True, allocates=False)
def exp2(x):
    """Return two to the power of x in -120..120, within a relative error of 2e-4."""
    x = min(max(x, f32(-120)), f32(120))
    whole = floor(x)
    part = x - whole
    # The whole part goes into the bits of the exponent; a cubic polynomial stands for 2**part.
    scale = np.int32((int32(whole) + int32(127)) << int32(23)).view(np.float32)
    return scale * (f32(1) + part * (f32(0.69606564) + part * (f32(0.22449434) + part * f32(0.07944024))))


@kernel(inlined=True, allocates=False)
def exp(x):
    """Return e to the power of x in -80..80, within a relative error of 2e-4."""
    return exp2(x * f32(1.4426950408889634))
