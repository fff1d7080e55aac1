"""NumPy's random stream in compiled code: the same seed gives the same draws.

PCG64 (O'Neill 2014, XSL-RR output) seeded through numpy's SeedSequence; normal numbers by the
ziggurat method (Marsaglia and Tsang 2000) with numpy's tables; bounded integers by Lemire's method
(2019) on half words, the unused half kept for the next. The EPISODE record holds the state.
"""

import math
from pathlib import Path

import numpy as np

from socialiq.worlds.highway.core.compile import allocating_kernel, kernel

_TABLES = np.load(Path(__file__).with_name("ziggurat.npy"), allow_pickle=False)
_INSIDE = _TABLES[0].copy()  # thresholds below which a draw lies inside its layer
_WIDTH = _TABLES[1].view(np.float64).copy()
_HEIGHT = _TABLES[2].view(np.float64).copy()
_TAIL = 3.654152885361009  # where the lowest layer's tail begins
_INVERSE_TAIL = 0.2736612373297583

_MULTIPLIER_HIGH = np.uint64(0x2360ED051FC65DA4)
_MULTIPLIER_LOW = np.uint64(0x4385DF649FCCF645)
_LOW_32 = np.uint64(0xFFFFFFFF)
_LOW_52 = np.uint64(0xFFFFFFFFFFFFF)
_WORD = np.uint64(32)
_ONE = np.uint64(1)
_ZERO = np.uint64(0)

_POOL = 4  # words of SeedSequence's pool


@allocating_kernel
def seed(episode, entropy):
    """Seed the stream as `numpy.random.default_rng(entropy)` does.

    Args:
        episode: EPISODE record that holds the stream.
        entropy: Seed, uint64.
    """
    pool = np.zeros(_POOL, np.uint64)
    constant = np.uint64(0x43B0D7E5)
    pool[0] = entropy & _LOW_32
    pool[1] = entropy >> _WORD
    for word in range(_POOL):
        pool[word], constant = _hash(pool[word], constant)
    for source in range(_POOL):
        for target in range(_POOL):
            if source != target:
                hashed, constant = _hash(pool[source], constant)
                mixed = np.uint64(0xCA01F9DD) * pool[target] - np.uint64(0x4973F715) * hashed
                mixed = mixed & _LOW_32
                pool[target] = mixed ^ mixed >> np.uint64(16)
    words = np.zeros(8, np.uint64)
    constant = np.uint64(0x8B51F9DD)
    for number in range(8):  # the 128-bit state, high half first, then the increment
        value = pool[number % _POOL] ^ constant
        constant = (constant * np.uint64(0x58F38DED)) & _LOW_32
        value = (value * constant) & _LOW_32
        words[number] = value ^ value >> np.uint64(16)
    high = words[0] | words[1] << _WORD
    low = words[2] | words[3] << _WORD
    episode.state_high = _ZERO
    episode.state_low = _ZERO
    start_high = words[4] | words[5] << _WORD
    start_low = words[6] | words[7] << _WORD
    episode.increment_high = start_high << _ONE | start_low >> np.uint64(63)
    episode.increment_low = start_low << _ONE | _ONE
    _advance(episode)
    _add(episode, high, low)
    _advance(episode)
    episode.has_half_word = False
    episode.half_word = _ZERO


@kernel
def _hash(value, constant):
    value = (value ^ constant) & _LOW_32
    constant = (constant * np.uint64(0x931E8875)) & _LOW_32
    value = (value * constant) & _LOW_32
    return value ^ value >> np.uint64(16), constant


@kernel
def _add(episode, high, low):
    total = episode.state_low + low
    carry = _ONE if total < low else _ZERO
    episode.state_low = total
    episode.state_high = episode.state_high + high + carry


@kernel
def _advance(episode):
    """Advance the generator: multiply and add, modulo 2^128."""
    high = episode.state_high
    low = episode.state_low
    # The upper 64 bits of the 128-bit product of both low words, by their halves.
    left_low = low & _LOW_32
    left_high = low >> _WORD
    right_low = _MULTIPLIER_LOW & _LOW_32
    right_high = _MULTIPLIER_LOW >> _WORD
    middle = left_high * right_low + (left_low * right_low >> _WORD)
    cross = left_low * right_high + (middle & _LOW_32)
    upper = left_high * right_high + (middle >> _WORD) + (cross >> _WORD)
    episode.state_high = high * _MULTIPLIER_LOW + low * _MULTIPLIER_HIGH + upper
    episode.state_low = low * _MULTIPLIER_LOW
    _add(episode, episode.increment_high, episode.increment_low)


@kernel
def _next_word(episode):
    """Return 64 random bits."""
    _advance(episode)
    turn = episode.state_high >> np.uint64(58)
    mixed = episode.state_high ^ episode.state_low
    return mixed >> turn | mixed << (np.uint64(64) - turn & np.uint64(63))


@kernel
def _next_half_word(episode):
    """Return 32 random bits; the next call returns the upper half of the word."""
    if episode.has_half_word:
        episode.has_half_word = False
        return episode.half_word
    word = _next_word(episode)
    episode.has_half_word = True
    episode.half_word = word >> _WORD
    return word & _LOW_32


@kernel
def uniform(episode):
    """Return a float in [0, 1), as `Generator.uniform()`."""
    return np.float64(_next_word(episode) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel
def normal(episode):
    """Return a standard normal number, as `Generator.normal()`."""
    while True:
        word = _next_word(episode)
        layer = np.int64(word & np.uint64(0xFF))
        negative = (word >> np.uint64(8)) & _ONE
        distance = (word >> np.uint64(9)) & _LOW_52
        value = np.float64(distance) * _WIDTH[layer]
        if negative:
            value = -value
        if distance < _INSIDE[layer]:
            return value
        if layer == 0:
            while True:
                beyond = -_INVERSE_TAIL * math.log1p(-uniform(episode))
                bound = -math.log1p(-uniform(episode))
                if bound + bound > beyond * beyond:
                    negative = (distance >> np.uint64(8)) & _ONE
                    return -(_TAIL + beyond) if negative else _TAIL + beyond
        height = (_HEIGHT[layer - 1] - _HEIGHT[layer]) * uniform(episode) + _HEIGHT[layer]
        if height < math.exp(-0.5 * value * value):
            return value


@kernel
def up_to(episode, largest):
    """Return a uniform integer from 0 to `largest`, as NumPy's bounded draw.

    Args:
        episode: EPISODE record that holds the stream.
        largest: Largest integer, below 2**32 - 1; with 0 no number is drawn.
    """
    if largest == 0:
        return 0
    count = np.uint64(largest) + _ONE
    product = _next_half_word(episode) * count
    if (product & _LOW_32) < count:
        threshold = (_LOW_32 - np.uint64(largest)) % count
        while (product & _LOW_32) < threshold:
            product = _next_half_word(episode) * count
    return np.int64(product >> _WORD)


@kernel
def two_of(episode, count):
    """Return two different integers below a number, as `Generator.choice(count, 2, replace=False)`.

    Args:
        episode: EPISODE record that holds the stream.
        count: The number, at least 2.
    """
    first = up_to(episode, count - 2)
    second = up_to(episode, count - 1)
    if second == first:
        second = count - 1
    if up_to(episode, 1) == 0:
        first, second = second, first
    return first, second
