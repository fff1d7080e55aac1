"""Protocols of worlds: what training, evaluation, audits and pictures need of any world.

A `World` says what it is and makes a `Batch` of episodes. `evaluation.simulate` runs a `Simulator`
with an `Actor`; a batch is a simulator whose states can also be saved and copied. No code outside
of the worlds asks for the kind of a world; it asks for one of the capabilities below.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np
from gymnasium import Space, spaces
from jaxtyping import Bool, Float, Float32, Int8, Int64, Shaped

from socialiq.errors import UserError
from socialiq.types import ROWS, Memoryless, Policy, RewardPair

if TYPE_CHECKING:
    from socialiq.worlds.highway.render import View

_NONE = np.zeros(0)


class Decisions(NamedTuple):
    """Results of one decision in every episode of a batch; what a world doesn't report is empty."""

    observation: Float32[np.ndarray, "batch feature"]  # of the state reached, before any reset
    rewards: RewardPair  # of the decision, each (batch,)
    ending: Int8[np.ndarray, " batch"]  # values of `types.Ending`
    signals: Mapping[str, Float[np.ndarray, " batch"]]  # every named signal, unweighted
    speed: Float[np.ndarray, " batch"]  # the ego's speed, m/s or cells a step
    contact: Int8[np.ndarray, " batch"]  # values of `Contact`: who struck, if the ego collided
    # number of other vehicles that collided with each other
    neighbours_collided: Int64[np.ndarray, " batch"] = _NONE.astype(np.int64)
    # the ego's own reward and its neighbours' mean (thesis A.1), each (batch,)
    classical: RewardPair = RewardPair(_NONE, _NONE)
    # whether the ego's centre is beyond the edges of its closest lane
    off_road: Bool[np.ndarray, " batch"] = _NONE.astype(bool)


@runtime_checkable
class Simulator(Protocol):
    """Episodes side by side, one in each of `size` rows."""

    size: int

    @property
    def observation(self) -> Any:
        """Present observations of all rows."""

    def seen_by(self, policy: Any) -> Any:
        """Return what a policy observes: with the time at the end if it has one feature more."""

    def reset(self, seeds: Any = None, rows: Any = None) -> Any:
        """Begin an episode in each of some rows.

        Args:
            seeds: A seed for each of these rows. Without seeds some simulators continue the rows'
                streams, and some raise a `UserError`.
            rows: Rows, by numbers or as a mask; None: all.

        Returns:
            The observations of all rows.
        """

    def step(self, actions: Any, auto_reset: bool = True, rows: Any = None) -> Any:
        """Take a step in some rows.

        Args:
            actions: One action for each row of the batch; those of rows that take no step are not
                used.
            auto_reset: Whether a new episode begins where one ends.
            rows: Rows that take a step, by numbers or as a mask; None: all.

        Returns:
            At least `rewards` and `ending` of all rows.
        """


@runtime_checkable
class Batch(Simulator, Protocol):
    """Simulator whose state can be saved, restored and copied.

    Every episode has its own random stream, so results don't depend on the batch's size.
    """

    @property
    def time(self) -> Float32[np.ndarray, " batch"]:
        """Decisions since the last reset of every episode: the clock's feature."""
        ...

    def save(self) -> Any:
        """Return a copy of the state of every episode; its `rows(numbers)` picks or repeats."""

    def restore(self, state: Any) -> None:
        """Restore a state with as many rows; episodes go on from it with identical bits."""

    def branch(self, rows: Any) -> Batch:
        """Return a batch of copies of some episodes, which may repeat; this one is not changed."""
        ...


@runtime_checkable
class Actor(Protocol):
    """Chooses the actions of all rows of a simulator."""

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Note that an episode begins in each of some rows.

        Args:
            rows: Numbers of the rows.
            seeds: The seed of each of these episodes.
        """

    def decide(self, observation: Any, running: np.ndarray) -> np.ndarray:
        """Choose an action for each row.

        Args:
            observation: Observations of all rows, as the simulator gives them.
            running: Whether each row's episode runs, bool (row,).

        Returns:
            One action for each row; those of rows that don't run are not used.
        """
        ...


class World(abc.ABC):
    """World that policies drive in; capabilities that a world lacks have the defaults below."""

    name: str  # in hashes and reports too
    is_exact: ClassVar[bool] = False  # whether states can be listed, so that `table` has all
    shows_time: ClassVar[bool] = True  # whether policies may take the time, in decisions, too
    # whether a policy's random draws depend on the seed of the episode alone
    draws_by_seed: ClassVar[bool] = False
    drivers: ClassVar[tuple[str, ...]] = ()  # names of its rule-based drivers, for `driver`
    references: ClassVar[tuple[str, ...]] = ()  # drivers that audits compare every policy with
    walks: bool = False  # whether people cross, on foot or on bicycles
    agents: int = 1  # controlled vehicles of an episode
    shipped: tuple[str, ...] = ()  # studies whose policies are shipped for it, of the atlas

    @property
    def whole_episode(self) -> int:
        """Decisions of an episode where the demonstrators' records end before it; 0: they don't."""
        return 0

    @property
    def encoding(self) -> dict[str, Any]:
        """Settings of the offline dial that the world decides: its view, its whole episode."""
        return {"whole_episode": self.whole_episode}

    @property
    @abc.abstractmethod
    def description(self) -> str:
        """Name and options; worlds with equal descriptions are identical."""

    @property
    @abc.abstractmethod
    def n_features(self) -> int:
        """Length of an observation."""

    @property
    def schema(self) -> str:
        """Name and version of the schema of observations, as saved policies carry it."""
        return ROWS

    @property
    @abc.abstractmethod
    def action_space(self) -> Space[Any]:
        """Space of one action: `Discrete`, or a `Box` of values in [-1, 1]."""

    @property
    def n_actions(self) -> int:
        """Number of actions; a `UserError` if they are continuous."""
        if isinstance(self.action_space, spaces.Discrete):
            return int(self.action_space.n)
        raise UserError(
            f"the actions of this {self.name} are continuous: choose discrete ones, or a "
            "method for continuous actions"
        )

    @property
    def action_size(self) -> int:
        """Length of a continuous action; 0 if actions are discrete."""
        space = self.action_space
        return int(space.shape[0]) if isinstance(space, spaces.Box) else 0

    @property
    @abc.abstractmethod
    def reward(self) -> dict[str, Any]:
        """Definition of the reward pair as JSON, by weights and units, or hashes of its code."""

    @property
    def reward_id(self) -> str:
        """Name of the reward pair; it changes with the formulas."""
        return f"socialiq/{self.name}/1"

    def largest_difference(self, weights: tuple[float, float]) -> float | None:  # noqa: ARG002
        """Return the most by which two episodes' weighted rewards can differ; None: unknown."""
        return None

    @property
    def view(self) -> View | None:
        """The road as pictures show it; None without one."""
        return None

    def with_clock(self) -> World:
        """Return the world whose observations end with the time, if it has to be another one."""
        return self

    def table(self) -> Any:
        """Return the exact transitions, `enumerate.Table`, of a world that `is_exact`."""
        raise UserError(f"the states of {self.name} can't be listed, so nothing about it is exact")

    def driver(self, name: str, seed: int = 0) -> Policy:
        """Return a rule-based driver.

        Args:
            name: One of `drivers`.
            seed: Seed of the driver's random draws, if it has any.

        Raises:
            UserError: If the world has no driver of this name.
        """
        raise UserError(f"{self.name} has no rule-based driver {name!r} (seed {seed})")

    def shifted(self, text: str = "", front_end: str = "") -> World:
        """Return the same world with the shifts of a text, and a front end.

        Args:
            text: Shifts, as "latency=1,unseen=0.3".
            front_end: Perception between what is shown and every policy, as "latency=1".

        Raises:
            UserError: If the world has no sensors.
        """
        if not (text or front_end):
            return self
        raise UserError(f"{self.name} has no sensors that fail: leave out {text or front_end}")

    def showing(self, schema: str) -> World:
        """Return the same world with observations of a schema, `rows` or `route`.

        Args:
            schema: Name of the schema.

        Raises:
            UserError: If the world has no routes.
        """
        if schema == "rows":
            return self
        raise UserError(f"{self.name} has no routes: leave out observation={schema}")

    def other_traffic(self) -> dict[str, dict[str, Any]]:
        """Return the options of the same world with other traffic, by a name in words."""
        return {}

    @abc.abstractmethod
    def batch(self, size: int, threads: int = 1) -> Simulator:
        """Return episodes side by side.

        Args:
            size: Number of episodes.
            threads: Number of threads that share the episodes, if the world is compiled.
        """


class ConstantPolicy(Memoryless):
    """Policy that always chooses one action: a number, or a vector."""

    def __init__(self, action: int | np.ndarray) -> None:
        self.action = action

    def choose(self, _observation: Any, _deterministic: bool, /) -> np.ndarray:
        """Return the action for one observation."""
        return np.asarray(self.action)


def with_time(
    observation: Shaped[np.ndarray, "*batch feature"], time: Any, clock: bool = True
) -> Shaped[np.ndarray, "*batch observed"]:
    """Return observations that end with the time, the clock of every world; or without a clock.

    Args:
        observation: Observations without the time, (..., feature).
        time: Decisions since the last reset, as the world shows them, (...) or of its agents.
        clock: Whether the time is shown; if not, the observations are returned as they are.
    """
    if not clock:
        return observation
    column = np.reshape(time, (*observation.shape[:-1], 1))
    return np.concatenate([observation, column], axis=-1)


def observed_with_time(
    observation: Shaped[np.ndarray, "*batch feature"], time: Any, policy: Any
) -> Shaped[np.ndarray, "*batch observed"]:
    """Return what a policy observes: with the time at the end if it has one feature more.

    Args:
        observation: Observations without the time, (..., feature).
        time: As for `with_time`.
        policy: Its `n_features` decides; a policy without this attribute gets no time.
    """
    clock = getattr(policy, "n_features", None) == observation.shape[-1] + 1
    return with_time(observation, time, clock)


def rows_of(rows: Sequence[int] | np.ndarray | None, size: int) -> Bool[np.ndarray, " batch"]:
    """Return a mask of rows.

    Args:
        rows: Numbers of the rows, or a mask; None stands for all.
        size: Number of rows of the batch.
    """
    if rows is None:
        return np.ones(size, bool)
    chosen = np.zeros(size, bool)
    chosen[rows] = True
    return chosen
