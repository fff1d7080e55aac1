"""`dial` and `turn`: what a trained dial does at each angle, and the policy of one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.drivers import gridworld_of
from socialiq.cli.output import print_json, print_table
from socialiq.errors import UserError
from socialiq.evaluation.dial_exact import Sweep, sweep
from socialiq.evaluation.exact import Optimum
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.dial import Setting, setting


@dataclass(frozen=True)
class Dial:
    """What a dial does at each angle, exactly.

    Each row is an angle asked for. First the policy that the dial turns to: its mean sums, and its
    regret, how far they lie below the best at that angle. Then the mixture of two of the dial's
    policies, one drawn per episode, whose *behaviour* lies at that angle: the radius is the length
    of its mean sums, and the share is of the longest that any policy has there.

    Example: socialiq dial crossing7 --policy run/dial_0.safetensors
    """

    world: Annotated[str, tyro.conf.Positional]
    """crossing5 or crossing7."""
    policy: Path
    """File that `socialiq train-dial` wrote."""
    every: int = 5
    """Degrees between the rows."""
    soft: bool = False
    """Draw actions from softmax(Q/τ) instead of taking the best."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Query at every degree, evaluate exactly, print."""
        if self.every < 1:
            raise UserError(f"--every {self.every}: give whole degrees, 1 or more")
        dial = DialPolicy.load(self.policy)
        part = gridworld_of(self.world, dial).reachable_part()
        found = sweep(dial, part, "soft" if self.soft else "greedy")
        best = Optimum(part)
        rows = self.rows(found, best)
        back = found.backward_steps()
        summary = {
            "world": self.world,
            "policy": str(self.policy),
            "mean_regret": float(found.regrets(best.attainable).mean()),
            "rise_r_env": back.env,
            "drop_r_social": back.social,
        }
        if self.json:
            print_json(summary | {"angles": rows})
        else:
            print_table(rows, "angles in degrees; an empty cell: no mixture has that angle")
            print_table([{"quantity": name, "value": value} for name, value in summary.items()])
        return 0

    def rows(self, found: Sweep, best: Optimum) -> list[dict[str, Any]]:
        """One for each angle."""
        regrets = found.regrets(best.attainable)
        return [
            {
                "angle": angle,
                "r_env": metrics.r_env,
                "r_social": metrics.r_social,
                "behavioural_angle": metrics.angle,
                "regret": float(regret),
            }
            | _mixed(found, angle, best)
            for angle, metrics, regret in zip(found.angles, found.metrics, regrets, strict=True)
            if (angle - found.angles[0]) % self.every == 0
        ]


def _mixed(found: Sweep, angle: float, best: Optimum) -> dict[str, Any]:
    """The mixture at a behavioural angle; empty where there is none."""
    names = ("mix_first", "mix_second", "mix_share", "angle_error", "radius", "share_of_radius")
    try:
        one: Setting = setting(found.points, angle)
    except UserError:
        return dict.fromkeys(names, "")
    values = (
        found.angles[one.first],
        found.angles[one.second],
        one.share,
        0.0,
        one.radius,
        one.radius / best.attainable.radius(angle),
    )
    return dict(zip(names, values, strict=True))


@dataclass(frozen=True)
class Turn:
    """Make a dial's policy for one angle: a policy file like any other.

    Example: socialiq turn run/dial_0.safetensors --angle 30 --out prosocial.safetensors
    """

    dial: Annotated[Path, tyro.conf.Positional]
    """File that `socialiq train-dial` wrote."""
    angle: float
    """Social angle in degrees."""
    out: Path
    """Policy file to write."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Turn and write."""
        if self.out.exists():
            raise UserError(f"{self.out} exists already: name a new file")
        sha256 = DialPolicy.load(self.dial).at(self.angle).save(self.out)
        found = {"out": str(self.out), "angle": self.angle, "sha256": sha256}
        if self.json:
            print_json(found)
        else:
            print_table([found])
        return 0
