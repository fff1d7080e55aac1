"""One loop for seeded episodes of any simulator and any policy.

A `Simulator` is a back end: the compiled intersection (`play`), an enumerated gridworld or a
Gymnasium environment (`simulators`). An `Actor` adapts a policy to it. Experience for online
learners has no seeded episodes; its loops are in `learners.collect`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int64

from socialiq.errors import UserError
from socialiq.types import Ending, Policy

SOFT = 4172  # makes these draws independent of other draws from the same seed


class Step(NamedTuple):
    """One decision of the episodes that are running.

    Attributes:
        episode: Number of the episode in each row.
        running: Rows that decided.
        observation: Observations of all rows before the decision.
        action: Actions of all rows; only those of running rows are used.
        made: Result of the simulator: at least `rewards` and `ending` of all rows.
    """

    episode: Int64[np.ndarray, " row"]
    running: Bool[np.ndarray, " row"]
    observation: Any
    action: Int64[np.ndarray, " row"] | Float[np.ndarray, "row value"]
    made: Any


@runtime_checkable
class Simulator(Protocol):
    """Episodes side by side, one in each of `size` rows."""

    size: int

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Begin an episode in each of some rows."""
        ...

    def observe(self) -> Any:
        """Return the present observations of all rows."""
        ...

    def step(self, action: np.ndarray, running: np.ndarray) -> Any:
        """Take a step in the running rows; return at least `rewards` and `ending` of all rows."""
        ...


@runtime_checkable
class Actor(Protocol):
    """Chooses the actions of all rows."""

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Note that an episode begins in each of some rows."""
        ...

    def decide(self, observation: Any, running: np.ndarray) -> np.ndarray:
        """Return one action for each row; those of rows that don't run are not used."""
        ...


def simulate(
    simulator: Simulator, actor: Actor, seeds: Sequence[int] | np.ndarray
) -> Iterator[Step]:
    """Run one episode for each seed, decision by decision.

    A row takes the next seed as soon as its episode has ended.

    Args:
        simulator: Back end.
        actor: Source of the actions.
        seeds: Seed of each episode.

    Raises:
        UserError: If there are no seeds.
    """
    wanted = np.asarray(seeds)
    if not len(wanted):
        raise UserError("episodes must be at least 1, got 0")
    episode = np.arange(simulator.size)
    running = episode < len(wanted)
    begun, following = np.flatnonzero(running), int(running.sum())
    while running.any():
        if len(begun):
            simulator.begin(begun, wanted[episode[begun]])
            actor.begin(begun, wanted[episode[begun]])
        observation = simulator.observe()
        action = actor.decide(observation, running)
        made = simulator.step(action, running)
        yield Step(episode.copy(), running.copy(), observation, action, made)
        free = np.flatnonzero(running & (made.ending != int(Ending.NONE)))
        begun = free[: max(len(wanted) - following, 0)]
        running[np.setdiff1d(free, begun)] = False
        episode[begun] = following + np.arange(len(begun))
        following += len(begun)


@runtime_checkable
class SoftPolicy(Policy, Protocol):
    """Protocol of a policy that gives its action probabilities, as `nn.q_policy.QPolicy`."""

    def probabilities(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return the probability of each action."""
        ...


class SoftActor:
    """Draws the actions of a soft policy with uniform numbers of the episodes' seeds.

    So an episode does not depend on how many others run beside it. (A network's float32 products
    may: their last bits change with the number of rows, which changes a draw about once in a
    million decisions.)

    Args:
        policy: The policy.
        size: Rows of the simulator.
        block: Number of random numbers drawn at once for an episode.
    """

    def __init__(self, policy: SoftPolicy, size: int, block: int = 64) -> None:
        self._policy = policy
        self._streams: list[np.random.Generator | None] = [None] * size
        self._uniform = np.zeros((size, block))
        self._used = np.zeros(size, np.int64)

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Open the stream of each episode."""
        for row, seed in zip(rows.tolist(), seeds.tolist(), strict=True):
            self._streams[row] = np.random.default_rng([SOFT, seed])
        self._refill(rows)

    def decide(self, observation: Any, running: np.ndarray) -> Int64[np.ndarray, " row"]:
        """Draw an action for each row."""
        block = self._uniform.shape[1]
        self._refill(np.flatnonzero(running & (self._used == block)))
        cumulative = self._policy.probabilities(np.asarray(observation)).cumsum(axis=1)
        place = np.minimum(self._used, block - 1)
        draws = self._uniform[np.arange(len(place)), place][:, None]
        self._used[running] += 1
        chosen = (draws >= cumulative).sum(axis=1)
        return np.minimum(chosen, cumulative.shape[1] - 1).astype(np.int64)

    def _refill(self, rows: np.ndarray) -> None:
        for row in rows.tolist():
            stream = self._streams[row]
            assert stream is not None  # `begin` opened it
            self._uniform[row] = stream.random(self._uniform.shape[1])
        self._used[rows] = 0
