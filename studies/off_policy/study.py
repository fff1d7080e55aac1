"""Off-policy evaluation against exact values: how often its intervals hold, and when it says no.

Three demonstrators take the best first action of each state, or a random one. From their episodes
alone the policies of seven angles are evaluated. The truth is exact: only the episodes are random.
"""

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from socialiq import Demonstrations, equal_trajectories, score, tabulate, weights
from socialiq.evaluation import exact, off_policy, rollout
from socialiq.mdp.horizon import horizon_optimum
from socialiq.types import Row
from socialiq.worlds.enumerate import Table
from socialiq.worlds.registry import make_grid
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from socialiq_lab.study import Context, Findings, tracked
from socialiq_lab.tables import labelled, matching, mean


class Scene(NamedTuple):
    """A gridworld, and how its policies act."""

    part: Table  # reachable states
    places: dict[bytes, int]  # row of each state, by its bytes

    @staticmethod
    def of(world: str) -> "Scene":
        """Enumerate a world."""
        table = tabulate(make_grid(world)).reachable_part()
        return Scene(table, {state.tobytes(): row for row, state in enumerate(table.states)})

    def policy(self, angle: float, random: float) -> np.ndarray:
        """Return the best first actions for R(α), mixed with random ones.

        Args:
            angle: α in degrees.
            random: Share of random actions, 0 to 1.

        Returns:
            Probabilities of the actions, (state, action).
        """
        mdp = self.part.mdp
        reward = score(weights(angle), mdp.rewards)
        best = horizon_optimum(mdp, reward, self.part.world.horizon).actions[0]
        return (1.0 - random) * np.eye(mdp.n_actions)[best] + random / mdp.n_actions

    def data(self, episodes: int, explored: float, seed: int) -> Demonstrations:
        """Return equal numbers of episodes of each demonstrator.

        Args:
            episodes: Number of episodes of each demonstrator.
            explored: Share of random actions of the demonstrators, 0 to 1.
            seed: Seed of all draws.
        """
        demonstrations = {
            mode: rollout.rollout_table(
                self.part,
                self.policy(angle, explored),
                episodes,
                seed=len(rollout.MODES) * seed + number,
                mode=mode,
            ).transitions
            for number, (mode, angle) in enumerate(rollout.MODES.items())
        }
        return equal_trajectories(demonstrations, episodes, seed)

    def chances(self, policy: np.ndarray) -> off_policy.Chances:
        """Return a policy as a function of observations; an end's observation has no action."""
        n_actions = policy.shape[1]
        kind = self.part.states.dtype
        even = np.full(n_actions, 1.0 / n_actions)

        def of(observations: np.ndarray) -> np.ndarray:
            rows = [self.places.get(one.tobytes(), -1) for one in observations.astype(kind)]
            return np.array([policy[row] if row >= 0 else even for row in rows])

        return of


def jobs(config: Any) -> list[Job]:
    """Return a job for each world and share of random actions."""
    return [
        Job(f"estimates/{world}, {explored:g}", estimates, Part(config, (world, explored)))
        for world, explored in itertools.product(config.worlds, config.explored)
    ]


@keeps_rows
def estimates(part: Part, _folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Evaluate every policy from every set of episodes, and exactly."""
    config = part.study
    world, explored = part.of
    scene = Scene.of(world)
    rows: list[Row] = []
    for seed in tracked(config.seeds, on_stage, "off-policy evaluation", "data sets"):
        logged = off_policy.Logged.of(scene.data(config.episodes_each, explored, seed))
        evaluator = off_policy.Evaluator(logged, config.resamples, seed)
        for angle in config.angles:
            policy = scene.policy(angle, config.random if explored else 0.0)
            truth = exact.evaluate_exactly(scene.part, policy).value(angle)
            evaluation = evaluator.evaluate(scene.chances(policy))
            label = {"world": world, "explored": explored, "seed": seed, "angle": angle}
            rows += _estimates(label, evaluation, truth)
    return {"estimates": rows}


def compute_tables(_config: Any, context: Context) -> Findings:
    """Return what the jobs have kept, and the coverage of each estimator.

    Args:
        context: The finished jobs.

    Returns:
        Tables `estimates` and `pooled`.
    """
    tables = context.tables()
    pooled = [
        label | _pooled(group)
        for label, group in labelled(tables["estimates"], "world", "explored", "estimator")
    ]
    return Findings(tables | {"pooled": pooled}, {})


def _estimates(label: Row, evaluation: off_policy.OffPolicy, truth: float) -> Iterator[Row]:
    """Yield the row of each estimator: value and interval, empty where there is none."""
    for name, estimate, supported in (
        ("fitted Q", evaluation.fitted, evaluation.fitted_supported),
        ("importance, step by step", evaluation.weighted, evaluation.weighted_supported),
        ("importance, whole episodes", evaluation.whole, evaluation.weighted_supported),
    ):
        value, low, high = estimate.value(label["angle"])
        yield label | {
            "estimator": name,
            "exact": truth,
            "value": value if np.isfinite(value) else "",
            "low": low if np.isfinite(low) else "",
            "high": high if np.isfinite(high) else "",
            "covers": int(low - 1e-9 <= truth <= high + 1e-9),
            "supported": int(supported),
            "effective": evaluation.effective,
            "left": evaluation.left,
        }


def _pooled(group: Sequence[Row]) -> Row:
    """Coverage and error of the estimates that are called supported, and of those that are not."""
    row = {"estimates": len(group), "supported": mean(group, "supported")}
    for name, is_supported in (("supported", 1), ("others", 0)):
        estimates = [one for one in matching(group, supported=is_supported) if one["value"] != ""]
        errors = [abs(one["value"] - one["exact"]) for one in estimates]
        widths = [one["high"] - one["low"] for one in estimates if one["high"] != ""]
        row |= {
            f"covers_{name}": mean(estimates, "covers") if estimates else "",
            f"error_{name}": float(np.mean(errors)) if errors else "",
            f"largest_error_{name}": max(errors) if errors else "",
            f"width_{name}": float(np.mean(widths)) if widths else "",
        }
    return row
