"""Comparison of the roads with the real highway-env: same seeds, same actions, every field.

Checked with highway-env 1.12.1; needs the extra `highway`. Equal bits need the portable arithmetic
of `highway.PORTABLE`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.types import Policy
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.options import RoadOptions, is_over
from socialiq.worlds.highway.reference import RealScene
from socialiq.worlds.highway.rules import RulePolicy
from socialiq.worlds.highway.scene_batch import Batch
from socialiq.worlds.highway.scenes import ACTIONS, FASTER, IDLE, LANE_LEFT, SLOWER
from socialiq.worlds.highway.world import world_of
from socialiq.worlds.intersection.options import SIGHT, Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.reference import rewards_of
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.world import Decisions


class Compared(NamedTuple):
    """Differences of one episode between core and highway-env."""

    seed: int  # seed of the episode
    steps: int  # decisions compared; the comparison stops at the first discrete difference
    # 1 if vehicles, their order, lanes, flags, ending or contact differ anywhere, else 0
    discrete_differences: int
    max_deviation: float  # greatest difference of any continuous field: m, rad, m/s, m/s²
    max_observation_deviation: float  # greatest difference of any number of the observation
    max_reward_deviation: float  # greatest difference of r_env or r_social
    off_road: bool  # whether the ego was off the road after a decision


def _compare_episode(
    core: RoadBatch,
    real: RealScene | _RealIntersection,
    choose: Callable[[], np.ndarray],
    seed: int,
) -> Compared:
    """Run the episode of a seed on both sides, up to its end or the first discrete difference."""
    observation = core.reset([seed]).reshape(-1)
    worst = np.array([0.0, np.abs(real.reset(seed) - observation).max(), 0.0])
    is_same, worst[0] = _compared(core, real)
    steps = 0
    left = False
    running = is_same
    while running:
        action = choose()
        decisions = core.step(action, auto_reset=False)
        observation, ends_alike, paid = real.step(action[0], decisions)
        steps = steps + 1
        left = left or bool(decisions.off_road.any())
        is_same, deviation = _compared(core, real)
        is_same = is_same and ends_alike
        if is_same:
            gap = np.abs(decisions.observation.reshape(-1) - observation).max()
            worst = np.maximum(worst, [deviation, gap, paid])
        running = is_same and not is_over(decisions.ending.reshape(1, -1), joint=True)[0]
    return Compared(seed, steps, int(not is_same), *worst.tolist(), off_road=left)


def _compared(core: RoadBatch, real: RealScene | _RealIntersection) -> tuple[bool, float]:
    """Whether all discrete fields are equal, and the greatest difference of all continuous ones."""
    ours = core.buffers.vehicles[0]
    vehicles = real.records()
    ours = ours[: int(core.buffers.episodes[0]["vehicles"]) + int(ours["obstacle"].sum())]
    moving = ~ours["obstacle"]  # obstacles have neither drivers nor commands
    if len(ours) != len(vehicles):
        return False, 0.0
    worst = 0.0
    for name in set(ours.dtype.names) - real.uncompared:
        rows = slice(None) if name in ("identity", "crashed") else moving
        values = ours[name][rows]
        expected = vehicles[name][rows]
        if not np.issubdtype(values.dtype, np.floating):
            if not np.array_equal(values, expected):
                return False, 0.0
            continue
        with np.errstate(invalid="ignore"):  # infinite desired speeds
            apart = np.abs(values - expected)
        apart = np.where((values == expected) | np.isnan(expected), 0.0, apart)
        worst = np.maximum(worst, apart.max())
    return True, float(worst)


def compare_scene(
    scene: str, episodes: int, seed: int, actions: str = "discrete"
) -> Iterator[Compared]:
    """Run seeded episodes of a scene on the core and on highway-env, and compare every decision.

    Actions are drawn; in every fourth episode the ego keeps its lane and goes faster, in another it
    only changes its speed. Continuous ones are those of `compare_intersection`.

    Args:
        scene: Name of the scene.
        episodes: Number of episodes.
        seed: Seed of the first episode; episode i has seed + i.
        actions: The ego's actions: "discrete", "continuous" or "continuous_steering".

    Yields:
        The differences of each episode.

    Raises:
        UserError: If `episodes` is below 1, or the scene is unknown.
    """
    if episodes < 1:
        raise UserError(f"episodes must be at least 1, got {episodes}")
    world = world_of(scene, **({} if actions == "discrete" else {"actions": actions}))
    core = world.batch(1)
    real = RealScene(core.scene, core.options)
    for number in range(episodes):
        rng = np.random.default_rng(seed + number)
        choices = ((FASTER,), (IDLE, FASTER, SLOWER), range(LANE_LEFT, len(ACTIONS)))
        allowed = np.array(choices[min(number % 4, 2)])
        draw = partial(rng.choice, allowed, 1)
        if world.options.continuous:
            draw = partial(_commands_of_turn(number % 4, seed + number, world.options), 1)
        yield _compare_episode(core, real, draw, seed + number)


class _RealIntersection:
    """The back end highway_env as one side of a comparison (`RealScene`).

    highway-env's own rewards are compared too, with what its definition makes of the core's state.
    """

    uncompared: frozenset[str] = frozenset({"timer"})
    """Fields of a record that do nothing here: no driver changes lanes."""

    def __init__(self, options: Options, core: Batch) -> None:
        self._core = core
        self._batch = Intersection(options).batch(1, back_end="highway_env")
        self._row = self._batch.real.rows[0]

    def reset(self, seed: int) -> np.ndarray:
        return self._batch.reset([seed]).reshape(-1)

    def step(self, action: Any, decisions: Decisions) -> tuple[np.ndarray, bool, float]:
        real = self._batch.step(np.asarray([action]), auto_reset=False)
        alike = (real.ending == decisions.ending) & (real.contact == decisions.contact)
        over = is_over(decisions.ending.reshape(1, -1), joint=True)[0]
        paid = np.abs(np.subtract(real.rewards, decisions.rewards)).max()
        owned = rewards_of(self._core.buffers, decisions.off_road.reshape(-1))
        paid = max(paid, np.abs(owned - self._row.rewards).max())
        same = bool(alike.all()) and bool(over == self._row.over)
        return real.observation.reshape(-1), same, float(paid)

    def records(self) -> np.ndarray:
        buffers = self._batch.buffers
        return buffers.vehicles[0, : int(buffers.episodes[0]["vehicles"])]


def compare_intersection(
    options: Options, episodes: int, seed: int, driver: Policy | None = None
) -> Iterator[Compared]:
    """Run seeded episodes on the core and on highway-env, and compare after every decision.

    Continuous actions are drawn: full acceleration without steering; acceleration at random with
    little steering, in float32 and in float64; all at random.

    Args:
        options: Options of the intersection.
        episodes: Number of episodes.
        seed: Seed of the first episode; episode i has seed + i.
        driver: Policy of the ego. Without it go, idle, wait and random drive in turn; several
            agents drive at random.

    Yields:
        The differences of each episode.

    Raises:
        UserError: If `episodes` is below 1.
    """
    if episodes < 1:
        raise UserError(f"episodes must be at least 1, got {episodes}")
    core = Intersection(options).batch(1)
    real = _RealIntersection(options, core)
    for number in range(episodes):
        turn = _RANDOM if options.agents > 1 and not options.continuous else number % 4
        policy_of_ego = driver or _driver_of_turn(turn, seed + number, options)

        def choose(policy_of_ego: Policy = policy_of_ego) -> np.ndarray:
            seen = core.seen_by(policy_of_ego)
            chosen = policy_of_ego.predict(seen.reshape(-1, seen.shape[-1]))[0]
            return chosen.reshape(*core.shape, *chosen.shape[1:])

        yield _compare_episode(core, real, choose, seed + number)


_RANDOM = 3


def _driver_of_turn(turn: int, seed: int, options: Options) -> Policy:
    if not options.continuous:
        return policy(("go", "idle", "wait", "random")[turn], seed)
    draw = _commands_of_turn(turn, seed, options)
    return RulePolicy(lambda vehicles: draw(len(vehicles)), SIGHT)


def _commands_of_turn(turn: int, seed: int, options: RoadOptions) -> Callable[[int], np.ndarray]:
    """Return a function that draws continuous actions, (count, width)."""
    least, steering = ((1.0, 0.0), (-0.3, 0.1), (-1.0, 0.1), (-1.0, 1.0))[turn]
    kind = np.float64 if turn == 2 else np.float32
    low = np.array([least, -steering])
    high = np.array([1.0, steering])
    low = low[: options.width]
    high = high[: options.width]
    rng = np.random.default_rng(seed)
    return lambda count: rng.uniform(low, high, (count, len(low))).astype(kind)
