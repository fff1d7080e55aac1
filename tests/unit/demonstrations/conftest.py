from collections.abc import Sequence

import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.types import Ending, RewardPair


def make(
    lengths: Sequence[int],
    modes: Sequence[int] | None = None,
    mode_names: tuple[str, ...] = ("egoistic", "prosocial", "altruistic"),
    seed: int = 0,
    n_features: int = 2,
    n_actions: int = 3,
) -> Demonstrations:
    """Random episodes of the given lengths, each of which ends in its last row."""
    rng = np.random.default_rng(seed)
    rows = sum(lengths)
    ending = np.zeros(rows, np.int8)
    ending[np.cumsum(lengths) - 1] = rng.choice([kind for kind in Ending if kind], len(lengths))
    # Where terminal, some are also truncated: the clock may run out in the same step.
    terminated = ~np.isin(ending, [Ending.NONE, Ending.TIMEOUT])
    truncated = (ending == Ending.TIMEOUT) | (terminated & (rng.random(rows) < 0.5))
    mode = np.zeros(len(lengths)) if modes is None else np.array(modes)
    observation = rng.standard_normal((2, rows, n_features)).astype(np.float32)
    return Demonstrations(
        observation=observation[0],
        action=rng.integers(n_actions, size=rows, dtype=np.int32),
        next_observation=observation[1],
        terminated=terminated,
        truncated=truncated,
        ending=ending,
        rewards=RewardPair(rng.standard_normal(rows), rng.standard_normal(rows)),
        mode=np.repeat(mode, lengths).astype(np.int8),
        episode=np.repeat(np.arange(len(lengths)), lengths).astype(np.int32),
        step=np.concatenate([np.arange(length) for length in lengths]).astype(np.int32),
        mode_names=mode_names,
        n_actions=n_actions,
        source={"seed": seed},
    )


def same(a: Demonstrations, b: Demonstrations) -> bool:
    """Whether two tables agree in everything, to the bit."""
    columns = zip(a.arrays().values(), b.arrays().values(), strict=True)
    rest = [(d.mode_names, d.n_actions, d.source) for d in (a, b)]
    return rest[0] == rest[1] and all(
        x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes() for x, y in columns
    )


@pytest.fixture(name="make", scope="session")
def make_fixture():
    return make


@pytest.fixture(name="same", scope="session")
def same_fixture():
    return same
