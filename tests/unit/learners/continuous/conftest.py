from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.types import Ending, RewardPair, Step


@dataclass(frozen=True)
class Line:
    """A place on a line that an action moves; the ego wants to 1, the others want it at 0."""

    action_size = 1
    n_features = 1
    description = "line"

    def reset(self, key: Any) -> tuple[Any, Any]:
        start = jax.random.uniform(key, (1,), minval=-1.0, maxval=1.0)
        return (start, jnp.zeros((), jnp.int32)), start

    def advance(self, key: Any, episode: Any, action: Any) -> tuple[Any, Step]:
        place, time = episode
        after = jnp.clip(place + 0.5 * action, -2.0, 2.0)
        pair = RewardPair(-jnp.square(after[0] - 1.0), -jnp.square(after[0]))
        ending = jnp.where(time == 9, int(Ending.TIMEOUT), int(Ending.NONE)).astype(jnp.int32)
        return (after, time + 1), Step(after, pair, ending)


@pytest.fixture(scope="session")
def line():
    return Line()


def random_drives(seed: int = 0, episodes: int = 6) -> Demonstrations:
    """Episodes of uniform actions on the line, ten steps each."""
    rng = np.random.default_rng(seed)
    rows = []
    for episode in range(episodes):
        place = rng.uniform(-1.0, 1.0)
        for step in range(10):
            action = rng.uniform(-1.0, 1.0)
            after = np.clip(place + 0.5 * action, -2.0, 2.0)
            ending = Ending.TIMEOUT if step == 9 else Ending.NONE
            rows.append((place, action, after, ending, -((after - 1) ** 2), -(after**2), episode))
            place = after
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return Demonstrations.of(
        observation=columns[0][:, None],
        action=columns[1][:, None],
        next_observation=columns[2][:, None],
        ending=columns[3],
        rewards=RewardPair(columns[4], columns[5]),
        episode=columns[6],
        n_actions=0,
    )


@pytest.fixture(scope="session")
def drives():
    return random_drives()


@pytest.fixture(scope="session", name="random_drives")
def random_drives_fixture():
    return random_drives
