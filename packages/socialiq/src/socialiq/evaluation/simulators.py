"""Back ends of `simulate`: enumerated worlds, and Gymnasium environments."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

import gymnasium
import numpy as np
from jaxtyping import Float, Int, Int64, Shaped

from socialiq.errors import UserError
from socialiq.types import Ending, Policy, RewardPair, is_unit_box
from socialiq.worlds.enumerate import Table
from socialiq.worlds.tabular_policy import draw_actions


@runtime_checkable
class Chance(Protocol):
    """Source of the chance outcomes of an enumerated world."""

    def first(self, initial: Float[np.ndarray, " state"], episodes: int) -> np.ndarray:
        """Draw the first state of every episode."""
        ...

    def outcome(
        self, chances: Float[np.ndarray, "row outcome"], time: int, rows: np.ndarray
    ) -> np.ndarray:
        """Draw an outcome for each of some rows."""
        ...


class SharedChance:
    """Chance of all episodes from one stream of random numbers."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def first(self, initial: Float[np.ndarray, " state"], episodes: int) -> np.ndarray:
        """Draw the first state of every episode."""
        return self._rng.choice(len(initial), size=episodes, p=initial)

    def outcome(
        self,
        chances: Float[np.ndarray, "row outcome"],
        time: int,  # noqa: ARG002
        rows: np.ndarray,  # noqa: ARG002
    ) -> np.ndarray:
        """Draw an outcome for each of some rows."""
        return draw_actions(chances, self._rng)


class FixedChance:
    """Chance from uniform numbers that are fixed for each episode and time.

    Args:
        uniform: For the first state, then for every step.
    """

    def __init__(self, uniform: Float[np.ndarray, "episode draw"]) -> None:
        self._uniform = uniform

    def first(self, initial: Float[np.ndarray, " state"], episodes: int) -> np.ndarray:
        """Draw the first state of every episode."""
        return self._drawn(np.broadcast_to(initial, (episodes, len(initial))), self._uniform[:, 0])

    def outcome(
        self, chances: Float[np.ndarray, "row outcome"], time: int, rows: np.ndarray
    ) -> np.ndarray:
        """Draw an outcome for each of some rows."""
        return self._drawn(chances, self._uniform[rows, time + 1])

    @staticmethod
    def _drawn(
        chances: Float[np.ndarray, "row outcome"], uniform: Float[np.ndarray, " row"]
    ) -> np.ndarray:
        found = (uniform[:, None] >= chances.cumsum(axis=1)).sum(axis=1)
        return np.minimum(found, chances.shape[1] - 1)


class TableStep(NamedTuple):
    """Result of a step in an enumerated world, of all rows.

    Attributes:
        state: State reached.
        rewards: Rewards of the step.
        ending: Values of `Ending`; a timeout after the horizon's last step.
    """

    state: Int[np.ndarray, " row"]
    rewards: RewardPair
    ending: Int[np.ndarray, " row"]


class TableSimulator:
    """An enumerated world as a back end of `simulate`: all episodes at once, states observed.

    Args:
        table: The world, or its reachable part.
        episodes: Number of episodes.
        chance: Source of its chance outcomes.
    """

    def __init__(self, table: Table, episodes: int, chance: Chance) -> None:
        self._table, self._chance, self.size = table, chance, episodes
        self._state, self._time = np.zeros(episodes, np.int64), 0

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:  # noqa: ARG002
        """Draw the first states; the seeds are those of `chance`."""
        self._state[rows] = self._chance.first(self._table.mdp.initial, len(rows))

    def observe(self) -> Int64[np.ndarray, " row"]:
        """Return the present states; an episode that is over stays in its last one."""
        return self._state.copy()

    def step(self, action: np.ndarray, running: np.ndarray) -> TableStep:
        """Take a step in the running rows."""
        mdp, rows = self._table.mdp, np.flatnonzero(running)
        state, chosen = self._state[rows], action[rows]
        outcome = self._chance.outcome(mdp.probability[state, chosen], self._time, rows)
        after, ending = mdp.successor[state, chosen, outcome], mdp.ending[state, chosen, outcome]
        self._time += 1
        if self._time == self._table.world.horizon:
            ending = np.where(ending == Ending.NONE, int(Ending.TIMEOUT), ending)
        self._state[rows] = np.where(ending == Ending.NONE, after, state)
        reached, endings = self._state.copy(), np.zeros(self.size, np.int64)
        reached[rows], endings[rows] = after, ending
        pair = RewardPair(np.zeros(self.size), np.zeros(self.size))
        for side, reward in zip(pair, mdp.rewards, strict=True):
            side[rows] = reward[state, chosen]
        return TableStep(reached, pair, endings)


MOST_STEPS = 100_000
"""Of an episode; without a time limit it might never end."""


class GymStep(NamedTuple):
    """Result of a step in a Gymnasium environment.

    Attributes:
        observation: Next observation.
        rewards: Rewards of the step.
        ending: Value of `Ending`, in an array of one.
        speed: Speed of the ego, NaN if it is not reported.
    """

    observation: Any
    rewards: RewardPair
    ending: Int64[np.ndarray, " 1"]
    speed: float


class GymSimulator:
    """A Gymnasium environment as a back end of `simulate`: one row.

    Args:
        env: Environment with discrete actions, or arrays in [-1, 1].
        modulus: Modulus of the seeds, since not all environments accept large ones.

    Raises:
        UserError: If the actions are of another kind; in `step`, if an episode doesn't end.
    """

    size = 1

    def __init__(self, env: gymnasium.Env[Any, Any], modulus: int | None = None) -> None:
        space = env.action_space
        unit = isinstance(space, gymnasium.spaces.Box) and is_unit_box(space)
        if not (unit or isinstance(space, gymnasium.spaces.Discrete)):
            raise UserError(
                "only discrete actions are supported, or arrays in [-1, 1]: make the environment "
                "by make_environment, which scales them"
            )
        self._env, self._modulus = env, modulus
        self._seen, self._length = None, 0

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:  # noqa: ARG002
        """Reset the environment."""
        seed = int(seeds[0])
        self._seen, _ = self._env.reset(seed=seed % self._modulus if self._modulus else seed)
        self._length = 0

    def observe(self) -> list[Any]:
        """Return the observation as the environment gave it, in a list of one."""
        return [self._seen]

    def step(self, action: np.ndarray, running: np.ndarray) -> GymStep:  # noqa: ARG002
        """Take a step."""
        if self._length == MOST_STEPS:
            raise UserError(
                f"an episode has not ended after {MOST_STEPS:,} steps: wrap the environment "
                "in gymnasium.wrappers.TimeLimit"
            )
        after, reward, terminated, truncated, info = self._env.step(
            action[0] if action.ndim > 1 else int(action[0])
        )
        ending = Ending.of_step(terminated, truncated, info)
        pair, speed = RewardPair.of_step(reward, info), float(info.get("speed", np.nan))
        self._seen, self._length = after, self._length + 1
        return GymStep(after, pair, np.array([int(ending)]), speed)


class GymActor:
    """A policy with one observation at a time, and possibly a state within an episode."""

    def __init__(self, policy: Policy, deterministic: bool) -> None:
        self._policy, self._deterministic, self._state = policy, deterministic, None

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:  # noqa: ARG002
        """Forget the last episode."""
        self._state = None

    def decide(self, observation: list[Any], running: np.ndarray) -> Shaped[np.ndarray, "1 ..."]:  # noqa: ARG002
        """Return the policy's action."""
        action, self._state = self._policy.predict(
            observation[0], self._state, deterministic=self._deterministic
        )
        return np.array([int(action) if np.ndim(action) == 0 else np.asarray(action)])
