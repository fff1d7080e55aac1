"""`evaluate`: what a saved policy does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import gymnasium
import tyro

from socialiq.cli.output import print_json, print_table
from socialiq.errors import UserError
from socialiq.evaluation.exact import Optimum, action_table, evaluate_exactly
from socialiq.evaluation.rollout import Rollout, rollout_env, rollout_table
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import check_angle
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.registry import WORLDS, make


@dataclass(frozen=True)
class Evaluate:
    """Measure a saved policy: exactly in a gridworld, or by rollouts anywhere.

    Example: socialiq evaluate run/policy_0.safetensors --world crossing7 --angle 45
    """

    policy: Annotated[Path, tyro.conf.Positional]
    """Policy file that `socialiq train` wrote."""
    world: str = "crossing7"
    """crossing5, crossing7, or the id of any Gymnasium environment with discrete actions."""
    angle: float = 0.0
    """Angle in degrees at which regret is measured."""
    soft: bool = False
    """Draw actions from softmax(Q/τ) instead of taking the best."""
    episodes: int = 0
    """Roll out so many episodes; 0 evaluates exactly, which only the gridworlds allow."""
    seed: int = 0
    """Of the rollouts and the bootstrap."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Evaluate and print."""
        check_angle(self.angle)
        policy = QPolicy.load(self.policy)
        found = self.in_gridworld(policy) if self.world in WORLDS else self.in_gym(policy)
        if self.json:
            print_json(found)
        else:
            print_table([{"quantity": name, "value": value} for name, value in found.items()])
        return 0

    def in_gridworld(self, policy: QPolicy) -> dict[str, object]:
        """Exact or sampled metrics, with regret against the exact optimum."""
        table = tabulate(make(self.world))
        _check_fit(policy, table)
        part = table.reachable_part()
        readout = "soft" if self.soft else "greedy"
        if self.episodes:
            whole = action_table(policy, table, readout)
            rollout = rollout_table(table, whole, self.episodes, self.seed)
            metrics, found = rollout.metrics(), self.sampled(rollout)
        else:
            metrics = evaluate_exactly(part, action_table(policy, part, readout))
            found = {"method": "exact", **metrics._asdict()}
        regret = Optimum(part).regret(metrics, self.angle)
        return {**found, "readout": readout, "target_angle": self.angle, "regret": regret}

    def in_gym(self, policy: QPolicy) -> dict[str, object]:
        """Sampled metrics in a registered Gymnasium environment."""
        if not self.episodes:
            raise UserError(f"{self.world} can't be evaluated exactly: add --episodes N")
        try:
            env = gymnasium.make(self.world)
        except gymnasium.error.Error as error:
            raise UserError(
                f"unknown world '{self.world}': choose one of {', '.join(WORLDS)}, "
                "or a registered Gymnasium id"
            ) from error
        return self.sampled(
            rollout_env(env, policy, self.episodes, self.seed, deterministic=not self.soft)
        )

    def sampled(self, rollout: Rollout) -> dict[str, object]:
        """Metrics of a rollout; quantities that the environment doesn't tell are left out."""
        metrics = {
            name: value for name, value in rollout.metrics()._asdict().items() if value == value
        }
        estimate = rollout.angle(self.seed)
        return {
            "method": f"{self.episodes} episodes, seed {self.seed}",
            **metrics,
            "angle_low": estimate.low,
            "angle_high": estimate.high,
        }


def _check_fit(policy: QPolicy, table: Table) -> None:
    wanted = (policy.n_features, policy.n_actions)
    given = (table.world.n_features, table.world.n_actions)
    if wanted != given:
        raise UserError(
            f"the policy takes {wanted[0]} features and {wanted[1]} actions, {table.world.name} "
            f"has {given[0]} and {given[1]}: name the world it was trained for"
        )
