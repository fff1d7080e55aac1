"""Kernels count references only where they make arrays, and free all of them."""

import numpy as np
import pytest
from numba.core.runtime import _nrt_python  # pyright: ignore[reportAttributeAccessIssue]
from numba.core.runtime.nrt import rtsys

from socialiq.worlds.registry import make


@pytest.mark.parametrize("name", ["intersection", "intersection-caused"])
def test_what_a_decision_allocates_it_frees(name):
    batch = make(name).batch(4)
    batch.reset(np.arange(4))
    batch.step(np.ones(4, np.int64))
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    for _ in range(20):
        batch.step(np.ones(4, np.int64))
    after = rtsys.get_allocation_stats()
    _nrt_python.memsys_disable_stats()
    assert after.mi_alloc > before.mi_alloc
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free
