"""Entry point of the core for WebAssembly: `step.run` on memory that the caller lays out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba import types
from numba.np.numpy_support import carray

from socialiq.page.webassembly.arguments import ARGUMENTS
from socialiq.worlds.highway.options import SIGNALS
from socialiq.worlds.highway.state import FEATURES, Buffers
from socialiq.worlds.intersection.core import step
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.state import buffers_of


def entry_of(options: Options) -> Callable[..., None]:
    """Return the function to compile: pointers to arrays in the place of arrays.

    Args:
        options: Options that give the arrays' shapes; all others are in the settings.
    """
    # Not from the cache of the native one.
    run: Any = numba.njit(step.run.py_func, error_model="numpy")
    capacity, frames = options.capacity, options.frames
    observed, features, signals_of = options.observed_vehicles, len(FEATURES), len(SIGNALS)

    def entry(
        episodes, vehicles, before, after, present, reached, observation, signals, rewards,
        classical, speed, ending, contact, neighbours_collided, braking, trace,
        commands, entropy, seeded, actions, settings, rows, traced,
    ):  # fmt: skip
        buffers = Buffers(
            carray(episodes, (rows,)),
            carray(vehicles, (rows, capacity)),
            carray(before, (rows, capacity)),
            carray(after, (rows, capacity)),
            carray(present, (rows, 2)),
            carray(reached, (rows, observed, features)),
            carray(observation, (rows, observed, features)),
            carray(signals, (rows, signals_of)),
            carray(rewards, (rows, 2)),
            carray(classical, (rows, 2)),
            carray(speed, (rows,)),
            carray(ending, (rows,)),
            carray(contact, (rows,)),
            carray(neighbours_collided, (rows,)),
            carray(braking, (rows, capacity)),
            carray(trace, (traced, frames, capacity)),
        )
        inputs = carray(commands, (rows,)), carray(entropy, (rows,)), carray(seeded, (rows,))
        run(buffers, *inputs, carray(actions, (rows,)), carray(settings, (1,)), 0, rows)

    return entry


def signature_of(options: Options) -> Any:
    """Return the entry's Numba signature: a pointer for each array, then rows and traced rows."""
    arrays = [array.dtype for array in buffers_of(options, 1, traced=True)]
    pointers = [types.CPointer(numba.from_dtype(array)) for array in (*arrays, *ARGUMENTS.values())]
    return types.void(*pointers, types.int32, types.int32)
