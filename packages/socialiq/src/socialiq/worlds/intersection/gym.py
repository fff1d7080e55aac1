"""Intersection as a Gymnasium environment and as a vector environment."""

from __future__ import annotations

import dataclasses
from typing import Any

from gymnasium.vector import AutoresetMode

from socialiq.worlds.highway.gym import RoadEnv, RoadVectorEnv
from socialiq.worlds.intersection.batch import BackEnd, Batch
from socialiq.worlds.intersection.options import ContinuousOptions, Options
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import parse_options


def _made(options: dict[str, Any]) -> Intersection:
    kind = ContinuousOptions if "actions" in options else Options
    return Intersection(parse_options("intersection", kind, options))


class IntersectionEnv(RoadEnv):
    """Intersection with the Gymnasium interface; `RoadEnv` says what `info` has.

    Args:
        angle: Social angle α in degrees of the scalar reward R(α).
        render_mode: "rgb_array" or None.
        back_end: "core" or "highway_env".
        clock: Whether observations end with the time, in decisions since the reset.
        options: Fields of `Options`; with `actions`, of `ContinuousOptions`.

    Raises:
        UserError: If an option is unknown, the angle is invalid, or highway-env is not installed.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  as in Gymnasium

    def __init__(
        self,
        angle: float = 0.0,
        render_mode: str | None = None,
        back_end: BackEnd = "core",
        clock: bool = False,
        **options: Any,
    ) -> None:
        world = _made(options)
        batch = world.batch(1, back_end=back_end)
        super().__init__(world, batch, angle, render_mode, clock)
        self.world: Intersection = world
        self.batch: Batch = batch


class IntersectionVectorEnv(RoadVectorEnv):
    """Many episodes with Gymnasium's vector interface, on several threads (`RoadVectorEnv`).

    Args:
        num_envs: Number of episodes.
        angle: Social angle α in degrees of the scalar reward R(α).
        threads: Threads that share the episodes.
        back_end: "core" or "highway_env".
        autoreset_mode: Gymnasium's, NEXT_STEP by default.
        clock: As of `IntersectionEnv`.
        options: Fields of `Options`; with `actions`, of `ContinuousOptions`.

    Raises:
        UserError: If an option is unknown, or a number or the angle is invalid.
    """

    def __init__(
        self,
        num_envs: int = 1,
        angle: float = 0.0,
        threads: int = 1,
        back_end: BackEnd = "core",
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        clock: bool = False,
        **options: Any,
    ) -> None:
        world = _made(options)
        batch = world.batch(num_envs, threads, back_end)
        super().__init__(world, batch, angle, autoreset_mode, clock)
        self.world: Intersection = world
        self.batch: Batch = batch


def intersections(options: Options, count: int, clock: bool = False) -> IntersectionVectorEnv:
    """Return intersections to learn in: reset in the same step, on one thread.

    Args:
        options: Scenario.
        count: Episodes side by side.
        clock: Whether observations end with the time.
    """
    fields = dataclasses.asdict(options)
    return IntersectionVectorEnv(
        count, autoreset_mode=AutoresetMode.SAME_STEP, clock=clock, **fields
    )
