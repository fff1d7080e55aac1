"""Roads of highway-env, compiled, with identical episodes; `scenes` has most of them."""

from __future__ import annotations

from typing import NamedTuple

PORTABLE = {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL", "OPENBLAS_CORETYPE": "Haswell"}
"""Environment variables with which NumPy, and so highway-env, computes as the core does.

They matter on processors with AVX-512. The first selects the C library's functions, the second the
order of summation of the AVX2 kernels in products of small matrices. They must be set before the
process starts.
"""


class Compared(NamedTuple):
    """Differences of one episode between core and highway-env."""

    seed: int  # seed of the episode
    steps: int  # decisions compared; the comparison stops at the first discrete difference
    # 1 if vehicles, their order, lanes, flags, ending or contact differ anywhere, else 0
    discrete_differences: int
    max_deviation: float  # greatest difference of any continuous field: m, rad, m/s, m/s²
    max_observation_deviation: float  # greatest difference of any number of the observation
    max_reward_deviation: float  # greatest difference of r_env or r_social
    off_road: bool  # whether the ego was off the road after a decision
