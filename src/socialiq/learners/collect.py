"""Experience from any Gymnasium environment, for learners that train online outside JAX."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np

from socialiq.errors import UserError
from socialiq.learners import replay
from socialiq.learners.expert_table import Batch
from socialiq.learners.state import Lanes
from socialiq.nn.q_network import network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Ending, RewardPair


class GymCollector:
    """Fills each lane's replay from an environment of its own, chunk by chunk.

    Pass it as `before_chunk` of a learner's `train`. Every chunk begins with a reset that is
    seeded by the lane and the number of updates done, so a resumed run sees the same experience
    as an uninterrupted one.

    Args:
        make: Makes one environment with discrete actions.
        seeds: One for each lane.
        temperatures: τ of each lane's soft policy.
        steps: Environment steps for each chunk.

    Raises:
        UserError: If the actions are not discrete.
    """

    def __init__(
        self,
        make: Callable[[], gymnasium.Env[Any, Any]],
        seeds: Sequence[int],
        temperatures: Sequence[float],
        steps: int,
    ) -> None:
        self.environments = [make() for _ in seeds]
        self.seeds, self.temperatures, self.steps = seeds, temperatures, steps
        if not isinstance(self.environments[0].action_space, gymnasium.spaces.Discrete):
            raise UserError("only discrete actions are supported: wrap the environment")
        self._add = jax.jit(jax.vmap(replay.add_many))

    def __call__(self, lanes: Lanes, done: int) -> Lanes:
        """Let every lane act with its present network, and store what happens."""
        batches = [
            self._collect(lane, network_of(lanes.learnt.network, lane), done)
            for lane in range(len(self.environments))
        ]
        stacked = jax.tree.map(lambda *columns: jnp.stack(columns), *batches)
        ring = self._add(lanes.surroundings.replay, stacked)
        return lanes._replace(surroundings=lanes.surroundings._replace(replay=ring))

    def _collect(self, lane: int, network: Any, done: int) -> Batch:
        entropy = np.random.SeedSequence([self.seeds[lane], done])
        env, rng = self.environments[lane], np.random.default_rng(entropy)
        policy = QPolicy.of(network, self.temperatures[lane], {}, rng)
        observation, _ = env.reset(seed=int(rng.integers(2**31)))
        rows: list[tuple[Any, ...]] = []
        for _ in range(self.steps):
            action, _ = policy.predict(np.ravel(observation), deterministic=False)
            after, reward, terminated, truncated, info = env.step(int(action))
            kind = Ending.of_step(terminated, truncated, info)
            rows.append((observation, action, after, kind, *RewardPair.of_step(reward, info)))
            observation = env.reset()[0] if kind else after
        return _batch(rows)


def _batch(rows: list[tuple[Any, ...]]) -> Batch:
    observation, action, after, ending, env, social = zip(*rows, strict=True)
    return Batch(
        jnp.asarray(np.array([np.ravel(one) for one in observation], np.float32)),
        jnp.asarray(np.array(action, np.int32)),
        jnp.asarray(np.array([np.ravel(one) for one in after], np.float32)),
        jnp.asarray(np.array(ending, np.int32)),
        RewardPair(
            jnp.asarray(np.array(env, np.float32)), jnp.asarray(np.array(social, np.float32))
        ),
    )
