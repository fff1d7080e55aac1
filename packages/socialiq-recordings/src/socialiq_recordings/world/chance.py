"""Random numbers of an episode, each a function of its seed and of what it is for.

SplitMix64 (Steele, Lea and Flood 2014) as a hash: no draw depends on the order of others.
"""

from __future__ import annotations

import math

import numpy as np

from socialiq.worlds.highway.core.compile import kernel

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = (np.uint64(one) for one in (30, 27, 31, 11))
_ONE = np.uint64(1)
_UNIT = 2.0**-53


@kernel
def hashed(word):
    """Return the mixed bits of a word, SplitMix64's finaliser."""
    word = (word ^ (word >> _S30)) * _FIRST
    word = (word ^ (word >> _S27)) * _SECOND
    return word ^ (word >> _S31)


@kernel
def uniform(seed, purpose, number):
    """Return a number in [0, 1).

    Args:
        seed: The episode's, uint64.
        purpose: What it is for.
        number: Which one of these.
    """
    word = hashed(seed + _GOLDEN * np.uint64(purpose + 1))
    word = hashed(word + _GOLDEN * np.uint64(number + 1))
    return np.float64(word >> _S11) * _UNIT


@kernel
def normal(seed, purpose, number):
    """Return a standard normal number (Box and Muller 1958)."""
    first = uniform(seed, 2 * purpose, number)
    second = uniform(seed, 2 * purpose + 1, number)
    return math.sqrt(-2.0 * math.log(1.0 - first)) * math.cos(2.0 * math.pi * second)


@kernel
def following(seed):
    """Return the seed of the next episode of a stream."""
    return hashed(seed + _GOLDEN) + _ONE
