"""SplitMix64 (Steele, Lea and Flood 2014) as a hash: no random number depends on another."""

import numpy as np

from socialiq.worlds.highway.core.compile import elementwise, kernel

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31 = (np.uint64(bits) for bits in (30, 27, 31))


@kernel
def hashed(word):
    """Return the mixed bits of a word, SplitMix64's finaliser."""
    word = (word ^ (word >> _S30)) * _FIRST
    word = (word ^ (word >> _S27)) * _SECOND
    return word ^ (word >> _S31)


@elementwise
def following(state):
    """Return SplitMix64's next number after each state, uint64."""
    return hashed(state + GOLDEN)
