"""Gridworld type: finite features, rules with a few chance outcomes, and named signals."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
from gymnasium import spaces
from jaxtyping import Float, Int

from socialiq.errors import UserError
from socialiq.foreign import Later
from socialiq.social.angle import class_weights
from socialiq.types import ByClass, Ending, RewardPair, Step
from socialiq.worlds.enumerate import GridBatch, Table, episode_range, tabulate
from socialiq.worlds.world import World

jax: Any = Later("jax")
jnp: Any = Later("jax.numpy")

Signals = Mapping[str, Any]


class Feature(NamedTuple):
    """Integer coordinate of a state: its name, smallest value and number of values."""

    name: str
    low: int
    size: int


class Place(NamedTuple):
    """Place of a road user in a state."""

    slot: int  # number of the road user among the state's features; the ego is 0
    x: int  # column of its cell
    y: int  # row of its cell, upwards
    heading: int  # degrees counter-clockwise from east
    speed: int | None = None  # cells a step, where it is a feature
    on_foot: bool = False


class Outcome(NamedTuple):
    """Result of one action and one chance outcome."""

    state: Int[Any, " feature"]  # next state, int (features,)
    ending: Int[Any, ""]  # value of `Ending` (never TIMEOUT, which is the clock's)
    # named reward signals of the transition. They are small integers and halves, so they are exact
    # in float32, and weighting them in float64 gives exact rewards
    signals: Signals
    speed: Float[Any, ""]  # the ego's speed in cells per step


class Episode(NamedTuple):
    """A running episode: the state and the number of steps taken (the time)."""

    state: Int[Any, " feature"]
    time: Int[Any, ""]


@dataclass(frozen=True, eq=False)
class GridWorld(World):
    """A finite world given by its rules; also a `types.Simulator`.

    The exact transition table (`worlds.enumerate`), the Gymnasium environment (`worlds.gym`) and
    the pictures (`worlds.pictures`) all come from `rules`, `env_weights` and `social_weights`.
    """

    name: str
    options: Any  # a frozen dataclass
    features: tuple[Feature, ...]  # of a state; the observation is the state itself as float32
    actions: tuple[str, ...]  # names, in the order of their numbers
    start: tuple[tuple[tuple[int, ...], float], ...]  # initial states with their probabilities
    chance: tuple[float, ...]  # of each chance outcome, the same in every state
    horizon: int  # steps after which an episode is truncated (Ending.TIMEOUT)
    max_speed: int  # of the ego, cells per step
    rules: Callable[[Any, Any, Any], Outcome]  # of state, action, chance outcome; traceable by JAX
    env_weights: Mapping[str, float]  # of each signal in r_env
    social_weights: Mapping[str, float]  # of each signal in r_social
    places: Callable[[Sequence[int]], list[Place]]  # of the road users that are present in a state
    size: int  # number of columns and of rows; the roads cross in the middle
    units: tuple[str, ...] = ()  # names of the options that define the rewards
    # Weights of signals of road users who can be hurt, and the angle b of the classes: r_social is
    # cos b of the sum over `social_weights` plus sin b of the sum over these. Without such signals
    # it is the first sum.
    vulnerable_weights: Mapping[str, float] = field(default_factory=dict)
    class_angle: float = 0.0
    # Whether the rewards keep the parts of r_social by class, for learners of all class angles.
    by_class: bool = False
    crosswalk: int | None = None  # column of a crosswalk over the ego's road
    # Whether the time is observed too, as a last feature. The thesis' agents don't see it.
    clock: bool = False

    is_exact: ClassVar[bool] = True

    @property
    def action_space(self) -> spaces.Discrete:
        """Space of one action."""
        return spaces.Discrete(len(self.actions))

    @property
    def walks(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether people cross on foot."""
        return bool(self.vulnerable_weights)

    @property
    def observed(self) -> tuple[Feature, ...]:
        """Features of an observation: those of the state, and the time if there is a clock."""
        time = (Feature("time", 0, self.horizon + 1),) if self.clock else ()
        return self.features + time

    @property
    def one_hot(self) -> tuple[tuple[int, int], ...]:
        """One-hot code of an observation: least value and number of values by feature."""
        return tuple((feature.low, feature.size) for feature in self.observed)

    @property
    def encoding(self) -> dict[str, Any]:
        """Settings of the offline dial: every feature as a one-hot vector."""
        return {"view": "flat", "one_hot": self.one_hot}

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return len(self.observed)

    @property
    def description(self) -> str:
        """Name of the world, its options, and its clock."""
        parts = " by class" if self.by_class else ""
        return f"{self.name} {self.options}{parts}" + (" with clock" if self.clock else "")

    def with_clock(self) -> GridWorld:
        """Return the same world with the time as last feature of its observations."""
        return dataclasses.replace(self, clock=True)

    def with_parts(self) -> GridWorld:
        """Return the same world with r_social by class in the rewards of its simulator.

        Raises:
            UserError: If it has one class of road users only.
        """
        if not self.vulnerable_weights:
            raise UserError(f"{self.name} has vehicles only, so there is no class angle to choose")
        return dataclasses.replace(self, by_class=True)

    def table(self) -> Table:
        """Return the exact transitions of all states."""
        return tabulate(self)

    def batch(self, size: int, threads: int = 1) -> GridBatch:  # noqa: ARG002  NumPy has one
        """Return episodes side by side, in the states that some policy can reach.

        Args:
            size: Number of episodes.
            threads: Not used: episodes run in NumPy, on one thread.
        """
        return GridBatch(self.table().reachable_part(), size)

    @property
    def reward(self) -> dict[str, Any]:
        """Definition of the reward pair: weights of the signals, and the options that matter."""
        units = {name: getattr(self.options, name) for name in self.units}
        units |= {"horizon": self.horizon, "max_speed": self.max_speed}
        reward = {"env": dict(self.env_weights), "social": dict(self.social_weights)}
        if self.vulnerable_weights:
            reward["vulnerable"] = dict(self.vulnerable_weights)
            reward["classes"] = class_weights(self.class_angle)._asdict()
        return reward | {"units": units}

    def largest_difference(self, weights: tuple[float, float]) -> float:
        """Return the most by which the weighted rewards of two episodes can differ, exactly."""
        low, high = episode_range(self, weights)
        return high - low

    def other_traffic(self) -> dict[str, dict[str, Any]]:
        """Return the option of twice the vehicles; of 0.3 a step if the usual is 0 or above 0.5."""
        usual = getattr(self.options, "spawn_probability", None)
        if usual is None:
            return {}
        share = 2 * usual if 0.0 < usual <= 0.5 else 0.3
        return {f"vehicles spawning at {share:g} a step": {"spawn_probability": share}}

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each feature; their product is the number of states."""
        return tuple(feature.size for feature in self.features)

    @property
    def signal_names(self) -> tuple[str, ...]:
        """Names of all signals, those of r_env first."""
        return (*self.env_weights, *self.social_weights, *self.vulnerable_weights)

    def index(self, state: Any) -> Any:
        """Return the index of a state, or of states along the last axis, in C order of features."""
        values = np.asarray(state) - np.array([feature.low for feature in self.features])
        return np.ravel_multi_index(tuple(np.moveaxis(values, -1, 0)), self.shape)

    def states(self) -> Int[np.ndarray, "state feature"]:
        """Return all states in the order of their indices."""
        values = np.indices(self.shape).reshape(len(self.features), -1).T
        return (values + np.array([feature.low for feature in self.features])).astype(np.int32)

    def rewards(self, signals: Signals) -> RewardPair:
        """Return the reward pair (thesis 4.1), each component a weighted sum of its signals."""
        env, vehicle, *vulnerable = (
            sum(weight * signals[name] for name, weight in side.items())
            for side in (self.env_weights, self.social_weights, self.vulnerable_weights)
            if side
        )
        if not vulnerable:
            return RewardPair(env, vehicle)
        parts = ByClass(vehicle, *vulnerable)
        if self.by_class:
            return RewardPair(env, parts)
        weights = class_weights(self.class_angle)
        return RewardPair(
            env, weights.vehicle * parts.vehicle + weights.vulnerable * parts.vulnerable
        )

    def reset(self, key: Any) -> tuple[Episode, Float[Any, " feature"]]:
        """Draw an initial state."""
        states = jnp.array([state for state, _ in self.start])
        state = states[_draw(key, [probability for _, probability in self.start])]
        episode = Episode(state, jnp.zeros((), jnp.int32))
        return episode, self._observation(episode)

    def advance(self, key: Any, episode: Episode, action: Any) -> tuple[Episode, Step]:
        """Take one step; an episode that reaches the horizon ends with TIMEOUT.

        Args:
            key: Key of JAX's random numbers, for the chance outcome.
            episode: State and time before the step.
            action: Number of the action.

        Returns:
            The state and time after the step, and its observation, rewards and ending.
        """
        outcome = self.rules(episode.state, action, _draw(key, self.chance))
        time = episode.time + 1
        out_of_time = (outcome.ending == Ending.NONE) & (time >= self.horizon)
        ending = jnp.where(out_of_time, int(Ending.TIMEOUT), outcome.ending)
        rewards = self.rewards(outcome.signals)
        follows = Episode(outcome.state, time)
        return follows, Step(self._observation(follows), rewards, ending)

    def _observation(self, episode: Episode) -> Float[Any, " feature"]:
        values = jnp.append(episode.state, episode.time) if self.clock else episode.state
        return values.astype(jnp.float32)


def _draw(key: Any, probabilities: Sequence[float]) -> Any:
    """Draw an index; a certain outcome draws no random number, which also compiles faster."""
    if len(probabilities) == 1:
        return 0
    bounds = jnp.cumsum(jnp.array(probabilities))[:-1]
    return (jax.random.uniform(key) >= bounds).sum()
