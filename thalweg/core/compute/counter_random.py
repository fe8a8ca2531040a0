"""Counter-based random numbers: a hash of a key and counters, in compiled code, without any state.

The same numbers come out wherever they are computed, in whatever order; normal numbers may differ in their last bits
between a CPU and a GPU, whose logarithms and sines do.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel

u64 = np.uint64


@kernel(fastmath=False, allocates=False)
def splitmix64(key):
    """Return a 64-bit hash of a 64-bit key. Source: splitmix64 (Steele, Lea, Flood, "Fast Splittable Pseudorandom
    Number Generators", 2014)."""
    key = u64(key + u64(0x9E3779B97F4A7C15))
    key = u64((key ^ (key >> u64(30))) * u64(0xBF58476D1CE4E5B9))
    key = u64((key ^ (key >> u64(27))) * u64(0x94D049BB133111EB))
    return u64(key ^ (key >> u64(31)))


@kernel(fastmath=False, allocates=False)
def hashed(seed, episode, counter):
    """Return 64 random bits; each counter is used once in an episode."""
    return splitmix64(u64(splitmix64(u64(splitmix64(u64(seed)) + u64(episode))) + u64(counter)))


@kernel(fastmath=False, allocates=False)
def uniform(seed, episode, counter):
    """Return a uniform number in [0, 1); each counter is used once in an episode."""
    key = hashed(seed, episode, counter)
    return float(key >> u64(11)) * (1.0 / 9007199254740992.0)  # the upper 53 bits, times 2 ** -53


@kernel(fastmath=False, allocates=False)
def scene_of(seed, episode):
    """Return the seed, a non-negative int64, of everything that moves in an episode of an environment with a seed."""
    return np.int64(hashed(seed, episode, 0x5CE7E) >> u64(1))


@kernel(fastmath=False, allocates=False)
def weather_of(seed, episode):
    """Return the key, a non-negative int64, of the weather of an episode that has no generator of its own."""
    return np.int64(hashed(seed, episode, 0x3EA7) >> u64(1))


@kernel(fastmath=False, allocates=False)
def normal_pair(seed, episode, counter):
    """Return two independent standard normal numbers; they take two counters.

    Source: Box, Muller, "A Note on the Generation of Random Normal Deviates", 1958.
    """
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(seed, episode, counter)))
    angle = 2.0 * math.pi * uniform(seed, episode, counter + 1)
    return radius * math.cos(angle), radius * math.sin(angle)
