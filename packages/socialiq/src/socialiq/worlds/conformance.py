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
from socialiq.worlds.highway.options import is_over
from socialiq.worlds.highway.reference import RealScene
from socialiq.worlds.highway.scenes import ACTIONS, FASTER, IDLE, LANE_LEFT, SLOWER
from socialiq.worlds.highway.world import RoadBatch, world_of
from socialiq.worlds.intersection.options import FleetOptions, Options
from socialiq.worlds.intersection.policies import RulePolicy, policy
from socialiq.worlds.intersection.reference import rewards_of
from socialiq.worlds.intersection.world import Batch
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
    (is_same, worst[0]), steps, left = _compared(core, real), 0, False
    running = is_same
    while running:
        action = choose()
        decisions = core.step(action, auto_reset=False)
        observation, ends_alike, paid = real.step(action[0], decisions)
        steps, left = steps + 1, left or bool(decisions.off_road.any())
        is_same, deviation = _compared(core, real)
        is_same = is_same and ends_alike
        if is_same:
            gap = np.abs(decisions.observation.reshape(-1) - observation).max()
            worst = np.maximum(worst, [deviation, gap, paid])
        running = is_same and not is_over(decisions.ending.reshape(1, -1), joint=True)[0]
    return Compared(seed, steps, int(not is_same), *worst.tolist(), off_road=left)


def _compared(core: RoadBatch, real: RealScene | _RealIntersection) -> tuple[bool, float]:
    """Whether all discrete fields are equal, and the greatest difference of the others."""
    ours, vehicles = core.buffers.vehicles[0], real.records()
    moving = slice(None)  # obstacles have neither drivers nor commands
    if "obstacle" in ours.dtype.names:
        moving = ~ours["obstacle"]
    else:
        ours = ours[: int(core.buffers.episodes[0]["vehicles"])]
    if len(ours) != len(vehicles):
        return False, 0.0
    worst = 0.0
    for name in set(ours.dtype.names) - real.uncompared:
        rows = slice(None) if name in ("identity", "crashed") else moving
        values, expected = ours[name][rows], vehicles[name][rows]
        if not np.issubdtype(values.dtype, np.floating):
            if not np.array_equal(values, expected):
                return False, 0.0
            continue
        with np.errstate(invalid="ignore"):  # infinite desired speeds
            apart = np.abs(values - expected)
        apart = np.where((values == expected) | np.isnan(expected), 0.0, apart)
        worst = np.maximum(worst, apart.max())
    return True, float(worst)


def compare_scene(scene: str, episodes: int, seed: int) -> Iterator[Compared]:
    """Run seeded episodes of a scene on the core and on highway-env, and compare every decision.

    Actions are drawn; in every fourth episode the ego keeps its lane and goes faster, in another
    it only changes its speed. Episode i has seed + i.

    Raises:
        UserError: If `episodes` is below 1, or the scene is unknown.
    """
    if episodes < 1:
        raise UserError(f"episodes must be at least 1, got {episodes}")
    core = world_of(scene).batch(1)
    real = RealScene(core.scene, core.options)
    for number in range(episodes):
        rng = np.random.default_rng(seed + number)
        choices = ((FASTER,), (IDLE, FASTER, SLOWER), range(LANE_LEFT, len(ACTIONS)))
        allowed = np.array(choices[min(number % 4, 2)])
        draw = partial(rng.choice, allowed, 1)
        yield _compare_episode(core, real, draw, seed + number)


class _RealIntersection:
    """The back end highway_env as one side of a comparison (`RealScene`).

    highway-env's own rewards are compared too, with what its definition makes of the core's state.
    """

    uncompared: frozenset[str] = frozenset()

    def __init__(self, options: Options, core: Batch) -> None:
        self._core, self._batch = core, Batch(options, 1, back_end="highway_env")
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

    Without a driver go, idle, wait and random drive in turn, and several agents at random.
    Continuous actions are drawn: full acceleration without steering; acceleration at random with
    little steering, in float32 and in float64; all at random. Episode i has seed + i.

    Raises:
        UserError: If `episodes` is below 1.
    """
    if episodes < 1:
        raise UserError(f"episodes must be at least 1, got {episodes}")
    core = Batch(options, 1)
    real = _RealIntersection(options, core)
    for number in range(episodes):
        turn = _RANDOM if isinstance(options, FleetOptions) else number % 4
        policy_of_ego = driver or _driver_of_turn(turn, seed + number, options)

        def choose(policy_of_ego: Policy = policy_of_ego) -> np.ndarray:
            seen = core.seen_by(policy_of_ego)
            chosen = policy_of_ego.predict(seen.reshape(-1, seen.shape[-1]))[0]
            return chosen if options.continuous else chosen.reshape(core.shape)

        yield _compare_episode(core, real, choose, seed + number)


_RANDOM = 3


def _driver_of_turn(turn: int, seed: int, options: Options) -> Policy:
    if not options.continuous:
        return policy(("go", "idle", "wait", "random")[turn], seed)
    least, steering = ((1.0, 0.0), (-0.3, 0.1), (-1.0, 0.1), (-1.0, 1.0))[turn]
    kind = np.float64 if turn == 2 else np.float32
    low, high = np.array([least, -steering]), np.array([1.0, steering])
    low, high, rng = low[: options.width], high[: options.width], np.random.default_rng(seed)
    return RulePolicy(
        lambda vehicles: rng.uniform(low, high, (len(vehicles), len(low))).astype(kind)
    )
