"""Simulated drivers of known angles, and their decisions as choices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int64
from scipy.special import softmax

from socialiq.errors import UserError
from socialiq.evaluation.branching import branched_returns, observed
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import packaged_results
from socialiq.types import Ending, RewardPair
from socialiq.worlds.intersection.options import ACTIONS, Options
from socialiq.worlds.intersection.world import Batch
from socialiq_recordings.prediction.choices import ChoiceTable
from socialiq_recordings.trait.planted import before

DIAL = packaged_results() / "intersection-dial" / "dial.safetensors"
"""The dial whose policies drive; its middle ends the rollouts."""

OTHER_DIAL = packaged_results() / "intersection-dial-clock" / "calibrated.safetensors"
"""The dial that is the model of drivers: of another training, seed, network and observation."""

INFERENCES = (("planner", "returns"), ("dial", "returns"), ("dial", "another dial"))
"""Kinds of drivers, and what their angles are inferred from."""

MIXED = 10
"""Angles of the dial whose policies are the base predictor of dials; that of planners is even."""

RANDOM = 0.05
"""Share of random actions in it."""

CONFIDENCE = 0.9
"""Of the drivers' intervals."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    first_episode: int = 62_000_000
    """Seed of the first episode. 50,000,000 to 50,999,999 were used in development, 61,000,000 to
    61,999,999 by an earlier version."""
    repeats: int = 5
    """Populations of each kind and spread."""
    drivers: int = 30
    """Drivers of a population."""
    lengths: tuple[int, ...] = (2, 16)
    """Episodes of a driver that are used, half to infer and half to test."""
    mean: float = 45.0
    """Mean of the planted angles, degrees."""
    spreads: tuple[float, ...] = (0.0, 25.0)
    """Standard deviations of the planted angles; angles are cut off at 0 and 90 degrees."""
    strength: float = 3.0
    """β of planners, per typical difference of returns."""
    step: float = 10.0
    """Of the angles integrated over, degrees."""

    def __post_init__(self) -> None:
        """Check what no population can be made of."""
        if not self.lengths or any(length < 2 or length % 2 for length in self.lengths):
            raise UserError(f"lengths must be even numbers from 2, got {list(self.lengths)}")
        if self.drivers < 2 or self.repeats < 1:
            raise UserError("drivers must be at least 2, and repeats at least 1")
        if not self.step > 0 or 360 % self.step:
            raise UserError(f"step must divide 360, got {self.step:g}")


class Population(NamedTuple):
    """Drivers of known angles.

    Attributes:
        kind: planner or dial.
        angle: Of each driver, degrees.
        strength: β of planners, per unit of return.
    """

    kind: str
    angle: Float[np.ndarray, " driver"]
    strength: float


class Decided(NamedTuple):
    """Decisions of all drivers, in the order of time.

    Attributes:
        row: Number of the episode, driver by driver.
        log_base: log p of each action by the base predictor.
        env: Return of each action in r_env.
        social: Return of each action in r_social.
        action: The action taken.
        seen: What the ego observes, and the time.
    """

    row: Int64[np.ndarray, " decision"]
    log_base: Float[np.ndarray, "decision action"]
    env: Float[np.ndarray, "decision action"]
    social: Float[np.ndarray, "decision action"]
    action: Int64[np.ndarray, " decision"]
    seen: Float32[np.ndarray, "decision feature"]


def drive(population: Population, dial: DialPolicy, episodes: int, first_episode: int) -> Decided:
    """Drive every driver's episodes side by side, with the returns of every action.

    After its first action a rollout follows the dial at its middle, for every driver the same.

    Args:
        population: The drivers.
        dial: The trained dial.
        episodes: Number of episodes of each driver.
        first_episode: Seed of the first episode.
    """
    size = len(population.angle) * episodes
    batch = Batch(Options(), size)
    rng = np.random.default_rng(first_episode)
    batch.reset(first_episode)
    middle = dial.at((dial.low + dial.high) / 2)
    mixed = [dial.at(angle) for angle in np.linspace(dial.low, dial.high, MIXED).tolist()]
    policies = [dial.at(angle) for angle in population.angle] if population.kind == "dial" else []
    driver, columns = np.repeat(np.arange(len(population.angle)), episodes), []
    running = np.ones(size, bool)
    clock = dial.n_features > batch.observation.shape[1]
    while running.any():
        returns = branched_returns(batch, lambda rows: middle.predict(rows)[0], clock)
        observation = observed(batch, clock)
        if policies:
            of_driver = observation.reshape(len(policies), episodes, -1)
            actions = [
                policy.predict(rows)[0] for policy, rows in zip(policies, of_driver, strict=True)
            ]
            action = np.concatenate(actions)
        else:
            action = _planned(population, returns, driver, rng)
        rows = np.flatnonzero(running)
        base = base_of(mixed if policies else [], observation[rows])
        observation = observed(batch, clock=True)[rows]
        decided = (base, returns.env[rows], returns.social[rows], action[rows], observation)
        columns.append((rows, *decided))
        step = batch.step(np.where(running, action, 0), auto_reset=False, rows=running)
        running &= step.ending == int(Ending.NONE)
    return Decided(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def base_of(
    mixed: list[QPolicy], observation: Float[np.ndarray, "row feature"]
) -> Float[np.ndarray, "row action"]:
    """Return log p by the mixture of some policies, with `RANDOM` of random actions.

    Args:
        mixed: The policies; with none every action is equally likely.
        observation: Observations, the time last; a policy without a clock doesn't read it.
    """
    even = np.full((len(observation), len(ACTIONS)), 1 / len(ACTIONS))
    if not mixed:
        return np.log(even)
    chosen = [
        np.eye(len(ACTIONS))[policy.predict(observation[:, : policy.n_features])[0]]
        for policy in mixed
    ]
    return np.log((1 - RANDOM) * np.mean(chosen, axis=0) + RANDOM * even)


def _planned(
    population: Population,
    returns: RewardPair,
    driver: Int64[np.ndarray, " row"],
    rng: np.random.Generator,
) -> Int64[np.ndarray, " row"]:
    """Draw actions with probabilities in proportion to exp(β R(α)) of the returns."""
    radians = np.radians(population.angle)[driver, None]
    score = np.cos(radians) * returns.env + np.sin(radians) * returns.social
    below = softmax(population.strength * score, axis=1).cumsum(axis=1)
    return (below < rng.random((len(below), 1)) * below[:, -1:]).sum(axis=1)


def first_episodes(decided: Decided, episodes: int, used: int) -> Decided:
    """Return the decisions of each driver's first episodes, of so many episodes."""
    is_used = decided.row % episodes < used
    return Decided(*(column[is_used] for column in decided))


def choices_of(decided: Decided, episodes: int, used: int) -> ChoiceTable:
    """Return the decisions of each driver's first episodes as choices.

    Every driver drives alone, so that each is a chain.

    Args:
        decided: All decisions.
        episodes: Episodes of a driver in `decided`.
        used: Episodes of a driver to use: half of them to infer.
    """
    row, log_base, env, social, action, *_ = first_episodes(decided, episodes, used)
    driver, episode = np.divmod(row, episodes)
    order = np.lexsort([np.arange(len(row)), row])
    time = np.empty(len(row))
    time[order] = np.arange(len(row))
    half = (episode >= used // 2).astype(np.int64)
    grid = np.arange(len(ACTIONS), dtype=np.float64) - 1.0
    off = grid[action] - np.exp(log_base) @ grid
    return ChoiceTable(
        driver=driver,
        chain=driver,
        site=np.zeros_like(driver),
        time=time,
        half=half,
        conflict=np.ones(len(row), bool),
        moving=np.ones(len(row), bool),
        grid=grid,
        log_base=log_base,
        r_env=env,
        r_social=social,
        acceleration=grid[action],
        residual=before(off, driver, time),
    )
