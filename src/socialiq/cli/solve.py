"""`solve` and `front`: exact optima of a gridworld."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import tyro

from socialiq.cli.output import print_json, print_table
from socialiq.evaluation.exact import Optimum, evaluate_exactly
from socialiq.mdp.horizon import horizon_optimum
from socialiq.social.angle import angle_of, check_angle, score, weights
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import expert_policy

World = Annotated[str, tyro.conf.Positional]


@dataclass(frozen=True)
class Solve:
    """Compute the exact optimum of a world at a social angle.

    Example: socialiq solve crossing7 --angle 45
    """

    world: World
    """crossing5 or crossing7."""
    angle: float = 0.0
    """Social angle in degrees: 0 egoistic, 45 prosocial, 90 altruistic."""
    stationary: bool = False
    """Use value iteration at discount 0.99, independent of time, as in the thesis."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Solve, evaluate exactly, print."""
        angle = check_angle(self.angle)
        table = tabulate(make_grid(self.world))
        part = table.reachable_part()
        if self.stationary:
            whole = expert_policy(table, angle, "stochastic")
            metrics = evaluate_exactly(part, whole[table.mdp.reachable()])
        else:
            reward = score(weights(angle), part.mdp.rewards)
            best = horizon_optimum(part.mdp, reward, table.world.horizon)
            metrics = evaluate_exactly(part, best.probabilities(part.mdp.n_actions))
        found = {
            "world": self.world,
            "angle": angle,
            "stationary": self.stationary,
            "r_env": metrics.r_env,
            "r_social": metrics.r_social,
            "angle_hat": metrics.angle,
            "value": metrics.value(angle),
            "arrival": metrics.arrival,
            "collision": metrics.collision,
            "timeout": metrics.timeout,
            "states": table.mdp.n_states,
            "reachable_states": part.mdp.n_states,
        }
        if self.json:
            print_json(found)
        else:
            print_table([{"quantity": name, "value": value} for name, value in found.items()])
        return 0


@dataclass(frozen=True)
class Front:
    """Compute all trade-offs of r_env and r_social in a world: vertices, angles, radii.

    Example: socialiq front crossing7
    """

    world: World
    """crossing5 or crossing7."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Compute the attainable set, print its front."""
        attainable = Optimum(tabulate(make_grid(self.world)).reachable_part()).attainable
        vertices = []
        for env, social in attainable.front():
            number = int(np.flatnonzero((attainable.vertices == (env, social)).all(axis=1))[0])
            low, high = attainable.supporting_interval(number)
            vertices.append(
                {
                    "r_env": env,
                    "r_social": social,
                    "angle_hat": angle_of(env, social),
                    "optimal_from": max(low, 0.0),
                    "optimal_to": min(high, 90.0),
                }
            )
        radii = [
            {"angle": angle, "radius": attainable.radius(float(angle))}
            for angle in range(0, 91, 15)
        ]
        if self.json:
            print_json({"world": self.world, "front": vertices, "radius": radii})
        else:
            print_table(vertices, "Pareto front (degrees; optimal_from/to: angles it is best for)")
            print_table(radii, "Largest mean reward vector at each angle, by mixing policies")
        return 0
