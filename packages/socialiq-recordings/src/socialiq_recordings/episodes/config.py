"""Options of the conversion of recorded driving to episodes."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

from socialiq.errors import UserError, one_of
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.state import ACTIONS

Loss = Literal["between_decisions", "summed"]
Contact = Literal["evidence", "overlap", "predicted"]
Actions = Literal["meta-actions", "accelerations"]
Influence = Literal["observed", "reasoned"]

LEVELS = (-2.0, -1.0, 0.0, 1.0, 2.0)
"""m/s²; default levels of the discretisation of accelerations."""


@dataclass(frozen=True)
class EpisodeConfig:
    """Options that a recording needs in addition to those of the simulator.

    Attributes:
        policy_rate: Decisions per second; divides the recording's rate.
        target_speeds: Speeds in m/s that actions step through; the last is v_max of the rewards.
        loss: A neighbour's loss of speed. "between_decisions" is the simulator's: its speed at
            one decision minus that at the next, or since it came into view, each taken from the
            recording's own frame. "summed" adds up every fall from frame to frame at the
            recording's rate, so that a vehicle that brakes and speeds up again also counts.
        contact: Criterion of a collision. "overlap": the ego's rectangle overlaps another's.
            "evidence": besides, the velocity of one of the two changes at the same time faster
            than `shock`, as no brake can.
            "predicted" is the simulator's: or would have from the previous frame, at its speeds.
        shock: m/s². Tyres on dry asphalt give at most about 10.
        slack: m by which both rectangles are shorter and narrower than recorded before they
            overlap: recorded boxes may touch although the vehicles did not. 0 with "predicted".
        near: s. Two vehicles meet in a conflict if they are within `reach` of it at times
            that differ by at most this.
        reach: m before a junction within which a vehicle is at it.
        actions: Discretisation of the decisions. "meta-actions": slower, idle, faster, by the speed
            that the simulator would reach. "accelerations": the closest of `levels`.
        levels: Accelerations of the second, m/s², ascending.
        influence: Losses of speed that Eq 4.2 charges to the ego. "observed" is the thesis': every
            neighbour's. "reasoned": only those with a reason (`conflicts.influence`): the ego is
            in the other's way, moved first, and without it the other would have kept more speed.
        clock: Whether an episode times out after the options' duration, with that penalty.
            Recorded drivers have no such limit.
        options: Options and weights of the rewards; the three frequencies, speeds and the
            canonical order are set from these options and the recording.
    """

    policy_rate: int = 1
    target_speeds: tuple[float, ...] = (0.0, 4.5, 9.0)
    loss: Loss = "between_decisions"
    contact: Contact = "evidence"
    shock: float = 12.0
    slack: float = 0.3
    near: float = 3.0
    reach: float = 20.0
    actions: Actions = "meta-actions"
    levels: tuple[float, ...] = LEVELS
    influence: Influence = "observed"
    clock: bool = False
    options: Options = field(default_factory=Options)

    def __post_init__(self) -> None:
        if self.policy_rate < 1:
            raise UserError(f"policy rate must be at least 1, got {self.policy_rate}")
        one_of("loss", self.loss, get_args(Loss))
        one_of("contact", self.contact, get_args(Contact))
        one_of("actions", self.actions, get_args(Actions))
        one_of("influence", self.influence, get_args(Influence))
        steps = [b - a for a, b in itertools.pairwise(self.levels)]
        if len(self.levels) < 2 or not all(0 < step < math.inf for step in steps):
            raise UserError(f"levels must be two or more ascending numbers, got {self.levels}")
        for name in ("near", "reach", "slack", "shock"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise UserError(f"{name} must be a number of at least 0, got {value}")

    @property
    def n_actions(self) -> int:
        """Number of actions of the discretisation."""
        return len(ACTIONS) if self.actions == "meta-actions" else len(self.levels)

    def options_at(self, dt: float) -> Options:
        """Return the simulator's options at a recording's rate.

        Args:
            dt: s between frames.

        Raises:
            UserError: If the rate is not a whole multiple of the policy rate.
        """
        rate = round(1 / dt)
        if abs(rate * dt - 1) > 1e-6 or rate % self.policy_rate:
            raise UserError(
                f"the recording has a frame every {dt:g} s, and a decision needs a whole number "
                f"of them: choose a policy rate that divides {1 / dt:g}"
            )
        given: dict[str, Any] = {f.name: getattr(self.options, f.name) for f in fields(Options)}
        given |= {
            "simulation_frequency": rate,
            "policy_frequency": self.policy_rate,
            "target_speeds": self.target_speeds,
            "canonical": True,
        }
        return Options(**given)
