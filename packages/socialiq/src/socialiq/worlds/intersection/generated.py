"""Generated roads as worlds: their options, and the scene that options describe."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Literal

from socialiq.errors import UserError
from socialiq.worlds.highway.generated import (
    ARMS,
    LANES,
    MOST_SKEW,
    Layout,
    circle_of,
    road_of_layout,
    stop_of_crossing,
)
from socialiq.worlds.highway.options import AgentOptions
from socialiq.worlds.highway.scenes import Scene
from socialiq.worlds.intersection.options import (
    ACTIONS,
    ALONG,
    SIGHT,
    SPEED_LIMIT,
    Destination,
    Options,
)

ROAD = "road"
"""Name of the world."""


@dataclass(frozen=True)
class _LayoutOptions:
    """Road, and what differs from the intersection."""

    # of the ego: "left" is the first arm clockwise, "right" the last, "straight" the one to which
    # the way turns least; "random" draws one of all
    destination: Destination = "left"
    duration: float = 30.0  # seconds after which an episode times out
    # whether drivers search for leaders beyond the end of their lane
    connected_lanes: bool = True
    canonical: bool = True  # break exact ties by the order of vehicles and lanes, not by rounding
    seed: int = 0  # draws each of the following properties that isn't given
    shape: Literal["drawn", "crossing", "roundabout"] = "drawn"  # a crossing, or a roundabout
    arms: int | None = None  # number of arms, 3 to 5
    lanes: int | None = None  # lanes of each arm in each direction, 1 or 2
    # "main": the main road or the circle has priority; "stop": drivers roll to an all-way stop;
    # "none": no arm has priority. Of equals, the one that has the other further ahead yields
    priority: Literal["drawn", "main", "stop", "none"] = "drawn"
    skew: float | None = None  # degrees by which the side arms are turned, -30 to 30
    enters: int | None = None  # the ego's arm, clockwise from the first side arm, 0


@dataclass(frozen=True)
class GeneratedOptions(_LayoutOptions, Options):  # pyright: ignore[reportIncompatibleVariableOverride]
    """Options of a generated road: those of the intersection, and its layout.

    Raises:
        UserError: As `Options`, and if the layout is not one that is generated.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.seed < 0:
            raise UserError(f"seed must be at least 0, got {self.seed}")
        layout = self.layout
        arms = layout.arms
        whole = {"arms": ARMS, "lanes": LANES, "enters": (0, arms - 1)}
        for name, (least, most) in whole.items():
            value = getattr(layout, name)
            if not (isinstance(value, int) and least <= value <= most):
                raise UserError(
                    f"{name} must be a whole number from {least} to {most}, got {value}"
                )
        if not abs(layout.skew) <= MOST_SKEW:
            raise UserError(
                f"skew must lie between -{MOST_SKEW:g} and {MOST_SKEW:g} degrees, got {layout.skew}"
            )

    @property
    def fixed(self) -> dict[str, int | float | str]:
        """Properties of the layout that the options give, by field of `Layout`."""
        numbers = {name: getattr(self, name) for name in ("arms", "lanes", "skew", "enters")}
        words = {"form": self.shape, "priority": self.priority}
        return {
            name: value
            for name, value in (numbers | words).items()
            if value is not None and value != "drawn"
        }

    @property
    def layout(self) -> Layout:
        """Properties of the road: those that are given, and those that the seed draws."""
        by_seed = Layout.of_seed(self.seed)
        fixed = self.fixed
        arms = int(fixed.get("arms", by_seed.arms))
        return by_seed._replace(enters=by_seed.enters % max(arms, 1))._replace(**fixed)

    @property
    def places(self) -> int:
        """Number of crosswalks."""
        return self.layout.arms

    @property
    def exits(self) -> dict[Destination, int]:
        """Number of the arm of each exit, in right-hand traffic; 0 draws one."""
        directions = self.layout.directions
        turns = [math.remainder(angle - directions[0] - math.pi, math.tau) for angle in directions]
        ahead = min(range(1, len(turns)), key=lambda arm: abs(turns[arm]))
        return {"random": 0, "left": 1, "straight": ahead, "right": len(turns) - 1}

    @property
    def spelled(self) -> dict[str, int | float | str]:
        """Every property of the layout by option, for declarations."""
        properties = self.layout._asdict()
        return {"seed": self.seed, "shape": properties.pop("form"), **properties}


@dataclass(frozen=True)
class GeneratedFleetOptions(AgentOptions, GeneratedOptions):  # pyright: ignore[reportIncompatibleVariableOverride]
    """Options of a generated road with several controlled vehicles.

    They enter as an ego does, on the arms in turn from the ego's on.

    Raises:
        UserError: As `GeneratedOptions`, and if there are too many agents.
    """


@functools.lru_cache(maxsize=64)
def scene_of_layout(layout: Layout) -> Scene:
    """Return the scene of a generated road."""
    road = road_of_layout(layout, SIGHT, ALONG, SPEED_LIMIT)
    round_circle = layout.form == "roundabout"
    return Scene(
        ROAD,
        road,
        {},
        circle=circle_of(layout, 0).radius if round_circle else 0.0,
        edge=0.0 if round_circle else stop_of_crossing(layout),
        actions=ACTIONS,
    )
