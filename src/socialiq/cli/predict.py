"""`predict-lambda`: the λ at which the greedy policy changes, without training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from socialiq.cli.output import print_json, print_table
from socialiq.evaluation.prediction import Setting, lines_of, predictions, problem_of, target_norm
from socialiq.types import Row
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid


@dataclass(frozen=True)
class PredictLambda:
    """Predict the λ at which each state's greedy action flips, by the closed form.

    For the pool of the experts of 0, 45 and 90 degrees in a gridworld. Assumptions: τ → 0,
    exact measures instead of batches, a table instead of a network, and w = 1. A flip is exact
    under these if `exact` is 1; later flips extrapolate straight lines beyond an extinction.
    At τ = 1 the flips come later (docs/theory.md).

    Example: socialiq predict-lambda crossing7 --angle 0 --target-kind to_go
    """

    world: Annotated[str, tyro.conf.Positional]
    """crossing5 or crossing7."""
    angle: float = 0.0
    """Social angle in degrees: 0 egoistic, 45 prosocial, 90 altruistic."""
    target_kind: str = "instantaneous"
    """instantaneous, to_go or advantage (of the pooled policy; the same flips as instantaneous)."""
    mixture: Literal["equal_trajectories", "equal_transitions"] = "equal_trajectories"
    """Equal numbers of episodes of each expert, or of transitions."""
    measure: Literal["occupancy", "rows"] = "occupancy"
    """Discounted occupancies, as in the theorems; or uniformly drawn rows, as in batches."""
    next_value: Literal["online", "target"] = "online"
    """Gradient through V(s') (online), or V(s') of a target network (target)."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Compute the lines and print their crossings."""
        part = tabulate(make_grid(self.world)).reachable_part()
        setting = Setting(self.angle, self.target_kind, self.mixture, self.measure)
        problem = problem_of(part, setting)
        norm = target_norm(problem)
        names = [feature.name for feature in part.world.features]
        rows: list[Row] = []
        for one in predictions(part, lines_of(problem, self.next_value)):
            state = part.states[one.flip.state]
            pairs = zip(names, state, strict=True)
            rows.append(
                {
                    "lambda": one.flip.strength,
                    "in_units": one.flip.strength * norm,
                    "exact": int(one.exact),
                    "state": " ".join(f"{name}={value}" for name, value in pairs),
                    "from": part.world.actions[one.flip.before],
                    "to": part.world.actions[one.flip.after],
                    "angle_before": one.before.angle,
                    "angle_after": one.after.angle,
                }
            )
        if self.json:
            first = rows[0]["lambda"] if rows else None
            found = {"world": self.world, "next_value": self.next_value} | setting._asdict()
            print_json(found | {"first_flip": first, "target_norm": norm, "flips": rows})
            return 0
        print(f"norm of the target without shaping: {norm:.4g} (in_units = lambda times it)")
        if rows:
            print_table(rows, "predicted flips, the earliest first; angles of greedy policies")
        else:
            print("no flip: the greedy policy stays the baseline's at every lambda")
        return 0
