"""Worlds of the study: contaminated data sets, inputs of learners, evaluation and default audits.

In the 7x7 world policies are evaluated exactly, at the intersection by the episodes of the audit.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np

from socialiq import Demonstrations, make, tabulate
from socialiq.demonstrations.mixture import equal_trajectories
from socialiq.demonstrations.trust import consistency
from socialiq.evaluation import exact, malice
from socialiq.evaluation.labels import trusted
from socialiq.evaluation.malice import Malice
from socialiq.evaluation.rollout import MODES, record, trajectory_datasets
from socialiq.learners.iq_learn import config as iq
from socialiq.types import Row
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.intersection import atlas
from socialiq.worlds.registry import make_grid
from socialiq_lab.audit_arena import AuditArena, course_of
from socialiq_lab.comparison import Setting
from socialiq_lab.comparison_runs import Arena, grid_arena, intersection_arena

GRID = "crossing7"
ROAD = "intersection"
OPTIONS = {"braking": "one_level"}
"""Of the 7x7 world: in the default one nothing can collide."""
ATTACKERS = {"hater": "hater", "rammer": "rammer", "adaptive": "hater"}
"""Attackers by name and what they do; the adaptive one forges within limits of `data trust`."""
BATCH = 512
"""Episodes side by side."""


class Poison(NamedTuple):
    """Contamination of a data set; `case` names the labels that a learner gets."""

    attacker: str
    case: str
    share: float
    seed: int

    def training(self, reads_labels: bool) -> "Poison":
        """Return the contamination whose training serves for this one."""
        if self.share == 0.0 or self.case == "recomputed":
            return self._replace(attacker="hater", case="recomputed" if self.share else "honest")
        if reads_labels and self.case == "forged":
            return self
        return self._replace(attacker=ATTACKERS[self.attacker], case="honest")


class Grid:
    """The 7x7 world: its data, its exact evaluation, and its default audits."""

    settings: ClassVar[Mapping[str, Setting]] = {}

    def __init__(self, config: Any) -> None:
        self.config = config
        self.table = tabulate(make_grid(GRID, **OPTIONS))
        part = self.table.reachable_part()
        self.ground = exact.Ground(self.table, part, exact.Optimum(part))
        course = course_of(self.table.world, config.audit_episodes, config.seeds[0])
        self.audits = AuditArena(course, OPTIONS)
        self.decided: dict[tuple[float, bytes], str] = {}

    def honest(self, seed: int) -> Demonstrations:
        """Return the episodes of the exact experts."""
        return trajectory_datasets(self.table, [seed], self.config.each)[0]

    def attacked(self, attacker: Malice, count: int, seed: int) -> Demonstrations:
        """Return episodes of the attacker's optimal policy."""
        return malice.attacked_table(self.table, attacker, count, 7000 + seed)

    def arena(self, datasets: Sequence[Demonstrations], on_report: Any) -> Arena:
        """Return the inputs of the learners.

        Args:
            datasets: Data set of each contamination.
            on_report: Progress callback of the training.
        """
        return grid_arena(self.table, datasets, self.config, 500, on_report)

    def measured(self, policy: Any, angle: float) -> Row:
        """Evaluate a greedy policy exactly, and audit it at an angle.

        Args:
            policy: Trained policy.
            angle: Angle in degrees of regret and declaration.

        Returns:
            Columns `regret`, `collision`, `arrival` and `verdict`; equal policies are audited once.
        """
        actions = exact.action_table(policy, self.ground.part, "greedy")
        metrics = exact.evaluate_exactly(self.ground.part, actions)
        row = {
            "regret": self.ground.optimum.regret(metrics, angle),
            "collision": metrics.collision,
            "arrival": metrics.arrival,
        }
        key = angle, actions.tobytes()
        if key not in self.decided:
            verdict, _ = self.audits.audited(policy, angle)
            self.decided[key] = verdict.decision.value
        return row | {"verdict": self.decided[key]}


class Road:
    """The intersection: the experts' and the planner's episodes, and default audits."""

    settings: ClassVar[Mapping[str, Setting]] = {
        "thesis": (("strength", iq.INTERSECTION_STRENGTH),),
        "clone_weighted": (("reweight_temperature", 0.3),),
    }

    def __init__(self, config: Any) -> None:
        self.config = config
        self.world = cast(RoadWorld, make(ROAD))
        self.audits = AuditArena(course_of(self.world, config.road_episodes, config.seeds[0]))

    def honest(self, seed: int) -> Demonstrations:
        """Return episodes of the atlas' experts; those of each seed differ."""
        each = self.config.road_each
        pools = {}
        for number, mode in enumerate(MODES):
            seeds = 1_000_000 * seed + number * each + np.arange(each)
            policy = atlas.load(f"expert_{mode}")
            batch = self.world.batch(BATCH)
            pools[mode] = record(batch, policy, seeds, mode, {"world": ROAD}).transitions
        return equal_trajectories(pools, each, seed)

    def attacked(self, attacker: Malice, count: int, seed: int) -> Demonstrations:
        """Return episodes of a planner with the attacker's rewards."""
        seeds = 1_000_000 * seed + 500_000 + np.arange(count)
        return malice.attacked_road(self.world, attacker, seeds, {"world": ROAD})

    def arena(self, datasets: Sequence[Demonstrations], on_report: Any) -> Arena:
        """Return the inputs of the learners.

        Args:
            datasets: Data set of each contamination.
            on_report: Progress callback of the training.
        """
        return intersection_arena(datasets, self.config.road_updates, on_report)

    def measured(self, policy: Any, angle: float) -> Row:
        """Drive the episodes of a greedy policy's default audit, and decide it at an angle.

        Args:
            policy: Trained policy.
            angle: Angle in degrees of regret and declaration.

        Returns:
            Columns `regret`, `collision`, `arrival` and `verdict`.
        """
        verdict, outcomes = self.audits.audited(policy, angle)
        row: Row = {"regret": verdict.regret.regret}
        row["collision"] = float(np.mean(outcomes.episodes.collision))
        row["arrival"] = float(np.mean(outcomes.episodes.arrival))
        return row | {"verdict": verdict.decision.value}


def contaminated(ground: Grid | Road, poison: Poison) -> Demonstrations:
    """Put a share of an attacker's episodes in the place of honest ones, with a case's labels.

    Args:
        ground: World of the episodes.
        poison: Attacker, case, share and seed.

    Returns:
        Data set of as many episodes; with the case "recomputed" the episodes with false labels are
        dropped.

    Raises:
        UserError: If no honest episode is left, or "recomputed" labels disagree in more than half.
    """
    honest = ground.honest(poison.seed)
    count = round(poison.share * honest.n_episodes)
    if not count:
        return honest
    bad = ground.attacked(malice.ATTACKERS[ATTACKERS[poison.attacker]], count, poison.seed)
    if poison.case != "honest":
        check = consistency(bad, honest) if poison.attacker == "adaptive" else None
        bad = malice.forged(bad, check)
    mixed = malice.poisoned(honest, bad, poison.seed)
    return trusted(mixed, "")[0] if poison.case == "recomputed" else mixed
