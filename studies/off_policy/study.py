"""Off-policy evaluation beside exact values: how often its intervals hold, and when it says no.

Three demonstrators of a gridworld, for 0, 45 and 90 degrees, take the best first action of each
state, or now and then a random one. From their episodes alone the policies of seven angles are
evaluated, which drive in the same way. The truth is exact, so only the episodes are random.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import equal_trajectories
from socialiq.evaluation.exact import evaluate_exactly
from socialiq.evaluation.off_policy import Chances, Estimate, Evaluator, Logged, OffPolicy
from socialiq.evaluation.rollout import MODES, rollout_table
from socialiq.mdp.horizon import horizon_optimum
from socialiq.social.angle import score, weights
from socialiq.types import Row
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.registry import make_grid
from socialiq_lab.study import Context, Findings, counter
from socialiq_lab.tables import groups, matching, mean, nested


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    worlds: tuple[str, ...] = ("crossing5", "crossing7")
    """Gridworlds."""
    seeds: tuple[int, ...] = tuple(range(540, 580))
    """Seeds of the episodes. 100 to 119 and 500 to 539 were used in development."""
    episodes_each: int = 60
    """Episodes of each demonstrator."""
    explored: tuple[float, ...] = (0.0, 0.1, 0.3)
    """Shares of random actions among the demonstrators'; 0: they show one action in each state."""
    random: float = 0.05
    """Share of random actions among those of the evaluated policies, where the data have any."""
    angles: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    """Angles of the evaluated policies, in degrees."""
    resamples: int = 200
    """Bootstrap resamples."""


class Scene(NamedTuple):
    """A gridworld, and how its policies act.

    Attributes:
        part: Reachable states.
        places: Row of each state, by its bytes.
    """

    part: Table
    places: dict[bytes, int]

    @staticmethod
    def of(world: str) -> Scene:
        """Enumerate a world."""
        table = tabulate(make_grid(world)).reachable_part()
        return Scene(table, {state.tobytes(): row for row, state in enumerate(table.states)})

    def policy(self, angle: float, random: float) -> np.ndarray:
        """Return the best first actions for R(α), mixed with random ones."""
        mdp = self.part.mdp
        reward = score(weights(angle), mdp.rewards)
        best = horizon_optimum(mdp, reward, self.part.world.horizon).actions[0]
        return (1.0 - random) * np.eye(mdp.n_actions)[best] + random / mdp.n_actions

    def data(self, config: Config, explored: float, seed: int) -> Demonstrations:
        """Return equal numbers of episodes of each demonstrator."""
        demonstrations = {
            mode: rollout_table(
                self.part,
                self.policy(angle, explored),
                config.episodes_each,
                seed=len(MODES) * seed + number,
                mode=mode,
            ).transitions
            for number, (mode, angle) in enumerate(MODES.items())
        }
        return equal_trajectories(demonstrations, config.episodes_each, seed)

    def chances(self, policy: np.ndarray) -> Chances:
        """Return a policy as a function of observations; an end's observation has no action."""
        n_actions, kind = policy.shape[1], self.part.states.dtype
        even = np.full(n_actions, 1.0 / n_actions)

        def of(observations: np.ndarray) -> np.ndarray:
            rows = [self.places.get(one.tobytes(), -1) for one in observations.astype(kind)]
            return np.array([policy[row] if row >= 0 else even for row in rows])

        return of


def compute_tables(config: Config, context: Context) -> Findings:
    """Evaluate every policy from every set of episodes, and exactly."""
    sets = [
        (world, explored, seed)
        for world in config.worlds
        for explored in config.explored
        for seed in config.seeds
    ]
    count = counter(context.on_stage, "off-policy evaluation", len(sets), "data sets")
    scenes = {world: Scene.of(world) for world in config.worlds}
    rows: list[Row] = []
    for number, (world, explored, seed) in enumerate(sets, start=1):
        rows += _set_rows(config, scenes[world], {"world": world}, explored, seed)
        count(number)
    pooled = [_pooled(values, group) for values, group in groups(rows, *_KEYS).items()]
    return Findings(
        {"estimates": rows, "pooled": pooled},
        {"pooled": nested(pooled, "world", "explored", "estimator")},
    )


def _set_rows(
    config: Config, scene: Scene, label: Row, explored: float, seed: int
) -> Iterator[Row]:
    """Yield the estimates of each policy from one set of episodes."""
    logged = Logged.of(scene.data(config, explored, seed))
    evaluator = Evaluator(logged, config.resamples, seed)
    for angle in config.angles:
        policy = scene.policy(angle, config.random if explored else 0.0)
        truth = evaluate_exactly(scene.part, policy).value(angle)
        evaluation = evaluator.evaluate(scene.chances(policy))
        for name, estimate, supported in _estimators(evaluation):
            value, low, high = estimate.value(angle)
            yield label | {
                "explored": explored,
                "seed": seed,
                "angle": angle,
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


def _estimators(found: OffPolicy) -> Iterator[tuple[str, Estimate, bool]]:
    yield "fitted Q", found.fitted, found.fitted_supported
    yield "importance, step by step", found.weighted, found.weighted_supported
    yield "importance, whole episodes", found.whole, found.weighted_supported


_KEYS = ("world", "explored", "estimator")


def _pooled(values: Sequence[Any], group: Sequence[Row]) -> Row:
    """Coverage and error of the estimates that are called supported, and of the others."""
    row: Row = dict(zip(_KEYS, values, strict=True)) | {"estimates": len(group)}
    row["supported"] = mean(group, "supported")
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
