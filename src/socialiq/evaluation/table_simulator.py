"""An enumerated world as a back end of `simulate`, and how its chance outcomes are drawn."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int, Int64

from socialiq.types import Ending, RewardPair
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
        state: Reached.
        rewards: Of the step.
        ending: Values of `Ending`; out of time after the horizon's last step.
    """

    state: Int[np.ndarray, " row"]
    rewards: RewardPair
    ending: Int[np.ndarray, " row"]


class TableSimulator:
    """An enumerated world as a back end of `simulate`: all episodes at once, states observed.

    Args:
        table: The world, or its reachable part.
        episodes: How many.
        chance: How its outcomes are drawn.
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
