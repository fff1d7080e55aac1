"""`solve`, `front` and `predict-lambda`: exact results of a gridworld, without training."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import tyro

from socialiq.cli.output import Printing, Result, listed, print_json, print_table
from socialiq.errors import UserError
from socialiq.evaluation.classes import ClassGround
from socialiq.evaluation.exact import evaluate_exactly, optimum_of
from socialiq.evaluation.prediction import Setting, lines_of, predictions, problem_of, target_norm
from socialiq.mdp.horizon import horizon_optimum
from socialiq.social.angle import angle_of, check_angle, score, weights
from socialiq.types import Row
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import expert_policy

World = Annotated[str, tyro.conf.Positional]


@dataclass(frozen=True)
class Solve(Printing):
    """Compute the exact optimum of a world at a social angle.

    Example: socialiq solve crossing7 --angle 45
    """

    world: World
    """crossing5, crossing7 or crosswalk7 (crosswalk7-B: class angle of B degrees)."""
    angle: float = 0.0
    """Social angle in degrees: 0 egoistic, 45 prosocial, 90 altruistic."""
    stationary: bool = False
    """Use value iteration at discount 0.99, independent of time, as in the thesis."""

    def result(self) -> Result:
        """Solve and evaluate exactly."""
        angle = check_angle(self.angle)
        table = tabulate(make_grid(self.world))
        reachable = table.reachable_part()
        if self.stationary:
            policy = expert_policy(table, angle, "stochastic")
            metrics = evaluate_exactly(reachable, policy[table.mdp.reachable()])
        else:
            reward = score(weights(angle), reachable.mdp.rewards)
            best = horizon_optimum(reachable.mdp, reward, table.world.horizon)
            metrics = evaluate_exactly(reachable, best.probabilities(reachable.mdp.n_actions))
        numbers = {
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
            "reachable_states": reachable.mdp.n_states,
        }
        return Result(numbers, listed(numbers))


@dataclass(frozen=True)
class Front(Printing):
    """Compute all trade-offs of r_env and r_social in a world: vertices, angles, radii.

    Example: socialiq front crossing7
    """

    world: World
    """crossing5, crossing7 or crosswalk7."""
    every: float | None = None
    """In crosswalk7: print the optimum of every direction of social angle and class angle, so many
    degrees apart, in the place of the front of one class angle."""

    def run(self) -> int:
        """Compute the attainable set, print its front."""
        if self.every is not None:
            return self._by_class(self.every)
        attainable = optimum_of(make_grid(self.world)).attainable
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

    def _by_class(self, every: float) -> int:
        """Print the optima of the octant of directions."""
        if not 0.0 < every <= 90.0:
            raise UserError(f"--every {every:g}: give degrees above 0, at most 90")
        rows = list(ClassGround(tabulate(make_grid(self.world))).optima(every))
        return self.show({"world": self.world, "optima": rows}, rows, "angles in degrees; exact")


@dataclass(frozen=True)
class PredictLambda(Printing):
    """Predict the λ at which each state's greedy action flips, by the closed form.

    For the pool of the experts of 0, 45 and 90 degrees in a gridworld. Assumptions: τ → 0,
    exact measures instead of batches, a table instead of a network, and w = 1. A flip is exact
    under these if `exact` is 1; later flips extrapolate straight lines beyond an extinction.
    At τ = 1 the flips come later (docs/theory.md).

    Example: socialiq predict-lambda crossing7 --angle 0 --target-kind to_go
    """

    world: World
    """crossing5, crossing7 or crosswalk7 (crosswalk7-B: class angle of B degrees)."""
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

    def run(self) -> int:
        """Compute the lines and print their crossings."""
        reachable = tabulate(make_grid(self.world)).reachable_part()
        setting = Setting(self.angle, self.target_kind, self.mixture, self.measure)
        problem = problem_of(reachable, setting)
        norm = target_norm(problem)
        names = [feature.name for feature in reachable.world.features]
        rows: list[Row] = []
        for prediction in predictions(reachable, lines_of(problem, self.next_value)):
            state = reachable.states[prediction.flip.state]
            pairs = zip(names, state, strict=True)
            rows.append(
                {
                    "lambda": prediction.flip.strength,
                    "in_units": prediction.flip.strength * norm,
                    "exact": int(prediction.exact),
                    "state": " ".join(f"{name}={value}" for name, value in pairs),
                    "from": reachable.world.actions[prediction.flip.before],
                    "to": reachable.world.actions[prediction.flip.after],
                    "angle_before": prediction.before.angle,
                    "angle_after": prediction.after.angle,
                }
            )
        if self.json:
            first = rows[0]["lambda"] if rows else None
            result = {"world": self.world, "next_value": self.next_value} | setting._asdict()
            print_json(result | {"first_flip": first, "target_norm": norm, "flips": rows})
            return 0
        print(f"norm of the target without shaping: {norm:.4g} (in_units = lambda times it)")
        if rows:
            print_table(rows, "predicted flips, the earliest first; angles of greedy policies")
        else:
            print("no flip: the greedy policy stays the baseline's at every lambda")
        return 0
