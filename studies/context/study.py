"""Angles that depend on the situation, beside the best constant ones.

In the gridworlds exactly: what it may mean to follow a rule (`evaluation.context`). At the
intersection by episodes: the improved dial turned by each rule, beside the same dial at constant
angles; and the decision losses of some of them at one rule, by context.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.evaluation.context import (
    ContextLosses,
    StateAngles,
    by_turning,
    consistent,
    evaluate_by_rule,
    planned,
    state_angles,
)
from socialiq.evaluation.context_rollouts import losses_of
from socialiq.evaluation.episodes import Episodes, episodes_of
from socialiq.mdp.front import AttainableSet, attainable_set, direction
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle_rule import AngleRule, angle_words
from socialiq.statistics.comparisons import holm, paired_difference
from socialiq.storage import load_arrays, packaged_results, save_arrays
from socialiq.types import Policy, RewardPair, Row
from socialiq.worlds.context_policy import ContextPolicy
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.registry import make_grid
from socialiq_lab.intersection.episodes import EpisodesRun, load_episodes, save_episodes
from socialiq_lab.intersection.rows import outcome_row
from socialiq_lab.jobs import Job, ProgressCallback
from socialiq_lab.results import Results
from socialiq_lab.study import Context, Findings, Study, View
from studies.context.config import (
    CANDIDATES,
    COMPARED,
    EXACT_RULES,
    GRIDS,
    MAIN,
    RULES,
    Config,
    exact_rule,
)
from studies.context.figures import draw

DIAL = ("intersection-dial-clock", "iterated.safetensors")
"""Study and file of the dial that is turned."""

_BATCH = 512
_EPISODES, _LOSSES = "episodes.safetensors", "losses.safetensors"
_SUPPORTS = tuple(np.arange(0.0, 90.1, 1.0).tolist())
"""Angles at which a rule is compared with the constant ones, in degrees."""

_MEANINGS = {"turning": by_turning, "consistent": consistent, "planned": planned}


@dataclass(frozen=True, kw_only=True)
class Driven(EpisodesRun):
    """Episodes of the dial at a constant angle, or turned by a rule.

    Attributes:
        angle: In degrees; None for the rule.
        rule: Content of the rule, {} for the angle.
        dial_sha256: SHA-256 of the dial's content.
    """

    angle: float | None = None
    rule: Mapping[str, Any]
    dial_sha256: str

    def policy(self, dial: DialPolicy) -> Policy:
        """Return the driver."""
        if self.angle is not None:
            return dial.at(self.angle)
        return ContextPolicy.of(dial, AngleRule.of(self.rule))


def dial_of() -> DialPolicy:
    """Return the dial that is turned."""
    return DialPolicy.load(packaged_results().joinpath(*DIAL))


def drive(
    config: Driven, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the outcome of every episode."""
    batch = Batch(config.options, min(_BATCH, config.episodes))
    save_episodes(folder / _EPISODES, episodes_of(batch, config.policy(dial_of()), config.seeds))
    on_progress(1.0)


def measure_losses(
    config: Driven, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the decision losses of every episode at the main rule."""
    dial, batch = dial_of(), Batch(config.options, min(_BATCH // 2, config.episodes))
    policy = config.policy(dial)
    _, found = losses_of(batch, policy, config.seeds, dial, RULES[MAIN], CANDIDATES)
    save_arrays(folder / _LOSSES, "losses", 1, found._asdict(), {})
    on_progress(1.0)


def _driven(config: Config, what: float | str, losses: bool = False) -> Driven:
    rule = RULES[what] if isinstance(what, str) else None
    return Driven(
        angle=None if isinstance(what, str) else what,
        rule={} if rule is None else rule.as_json(),
        dial_sha256=dial_of().turned.sha256,
        episodes=config.loss_episodes if losses else config.episodes,
        first_seed=config.first_loss if losses else config.first_episode,
    )


def _name(what: float | str) -> str:
    return what if isinstance(what, str) else f"{what:g}"


def plan(config: Config) -> list[Job]:
    """Return every job."""
    drivers: list[float | str] = [*config.constants, *RULES]
    jobs = [Job(f"driven/{_name(one)}", drive, _driven(config, one), cost=5.0) for one in drivers]
    compared: list[float | str] = [MAIN, *COMPARED]
    jobs += [
        Job(f"losses/{_name(one)}", measure_losses, _driven(config, one, losses=True), cost=20.0)
        for one in compared
    ]
    return jobs


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders, and the exact ones."""
    driven = {
        one.name.split("/", 1)[1]: load_episodes(context.work / one.name / _EPISODES)
        for one in context.jobs
        if one.stage == "driven"
    }
    losses = {
        one.name.split("/", 1)[1]: _losses(context.work / one.name / _LOSSES)
        for one in context.jobs
        if one.stage == "losses"
    }
    tables = {
        "exact": [row for world in GRIDS for row in exact_rows(world)],
        "drivers": [_driver_row(name, one) for name, one in driven.items()],
        "against_constants": against_constants(config, driven),
        "losses": [row for name, one in losses.items() for row in loss_rows(name, one)],
    }
    rules = {
        name: {"default": angle_words(rule.default), "contexts": list(rule.contexts)}
        | {"angles": [angle_words(one) for one in rule.angles], "toml": rule.as_toml()}
        for name, rule in RULES.items()
    }
    best = max(tables["against_constants"], key=lambda row: row["gain"])
    return Findings(tables, {"rules": rules, "best_rule": best, "main": MAIN})


def _losses(path: Path) -> ContextLosses:
    arrays, _ = load_arrays(path, "losses", 1)
    return ContextLosses(**arrays)


def _driver_row(name: str, episodes: Episodes) -> Row:
    kind = "rule" if name in RULES else "constant"
    totals = {"r_env": episodes.totals.env.mean(), "r_social": episodes.totals.social.mean()}
    kept = ("arrival", "collision", "timeout", "ego_struck", "length")
    outcome = outcome_row(episodes)
    measured = {side: float(value) for side, value in totals.items()}
    return {"driver": name, "kind": kind, "episodes": len(episodes.ending), **measured} | {
        measure: outcome[measure] for measure in kept
    }


def exact_rows(world: str) -> list[Row]:
    """Return the exact results of each meaning of each rule, and of constant angles at it."""
    table = tabulate(make_grid(world)).reachable_part()
    front, rows = attainable_set(table.mdp, table.world.horizon), []
    for name in EXACT_RULES:
        rule = exact_rule(world, name)
        angles = state_angles(table, rule)
        drivers = {meaning: make(table, angles) for meaning, make in _MEANINGS.items()}
        for angle in CANDIDATES:
            constant = StateAngles(np.full(len(table.states), angle), angles.context)
            drivers[f"{angle:g}"] = by_turning(table, constant)
        for driver, policy in drivers.items():
            rows.append(
                {"world": world, "rule": name, "driver": driver}
                | _exact_row(table, policy, rule, front)
            )
    return rows


def _exact_row(table: Table, policy: np.ndarray, rule: AngleRule, front: AttainableSet) -> Row:
    found = evaluate_by_rule(table, policy, rule)
    return {
        "r_env": found.totals.env,
        "r_social": found.totals.social,
        "weighed_by_step": found.weighed,
        "decision_loss": float(found.loss.sum()),
        "below_front": below_front(front, found.totals),
    }


def below_front(front: AttainableSet, totals: RewardPair) -> float:
    """Return the smallest regret over all angles from 0 to 90 degrees: 0 on the front."""
    point = np.array(totals)
    return min(front.optimum(angle).value - float(direction(angle) @ point) for angle in _SUPPORTS)


def against_constants(config: Config, driven: Mapping[str, Episodes]) -> list[Row]:
    """Return for each rule its gain over the best constant angle, where it is most favourable.

    A policy lies above the front of the constant angles, and of all mixtures of them, if at some
    angle β it has more R(β) than every constant angle. One half of the episodes selects β, so that
    the gain is largest, and the best constant angle there; the other half measures the gain.
    """
    order = np.random.default_rng(config.seeds[0]).permutation(config.episodes)
    select, check = np.array_split(order, 2)
    totals = {name: np.stack(one.totals, axis=1) for name, one in driven.items()}
    constants = [_name(angle) for angle in config.constants]
    corners = np.stack([totals[name][select].mean(axis=0) for name in constants])
    towards = np.stack([direction(angle) for angle in _SUPPORTS])
    rows: list[Row] = []
    for name in RULES:
        gains = towards @ totals[name][select].mean(axis=0) - (corners @ towards.T).max(axis=0)
        at = int(gains.argmax())
        best = constants[int((corners @ towards[at]).argmax())]
        pair = [totals[one][check] @ towards[at] for one in (name, best)]
        found = paired_difference(*pair)
        rows.append(
            {"rule": name, "at": _SUPPORTS[at], "constant": float(best), "gain": found.mean}
            | {"low": found.low, "high": found.high, "p": found.p, "episodes": len(check)}
        )
    for row, adjusted in zip(rows, holm([row["p"] for row in rows]).tolist(), strict=True):
        row["p_holm"] = adjusted
        differs = adjusted < 0.05
        row["verdict"] = ("above" if row["gain"] > 0 else "below") if differs else "tie"
    return rows


def loss_rows(name: str, losses: ContextLosses) -> list[Row]:
    """Return the decision losses of a driver in each context of the main rule.

    `compatible` lists the angles whose loss is not significantly larger than the least one.
    """
    rule, rows = RULES[MAIN], []
    for number, context in enumerate(rule.contexts):
        by_angle = losses.by_angle[:, number]
        least = int(by_angle.mean(axis=0).argmin())
        differences = [paired_difference(one, by_angle[:, least]) for one in by_angle.T]
        kept = [
            f"{angle:g}"
            for angle, one in zip(CANDIDATES, differences, strict=True)
            if one.low <= 0.0
        ]
        declared = paired_difference(losses.declared[:, number], np.zeros(len(by_angle)))
        rows.append(
            {"driver": name, "context": context, "declared_angle": angle_words(rule.angles[number])}
            | {"decisions": float(losses.decisions[:, number].mean())}
            | {"loss": declared.mean, "low": declared.low, "high": declared.high}
            | {f"at_{a:g}": float(v) for a, v in zip(CANDIDATES, by_angle.mean(0), strict=True)}
            | {"least_at": CANDIDATES[least], "compatible": " ".join(kept)}
        )
    return rows


def view(results: Results) -> Sequence[View]:
    """Return the tables to print."""
    exact = ("world", "rule", "driver", "r_env", "r_social", "decision_loss", "below_front")
    meanings = [row for row in results.tables["exact"] if row["driver"] in _MEANINGS]
    return [
        View([{name: row[name] for name in exact} for row in meanings], "exact, by meaning"),
        View(results.tables["against_constants"], "rules against constant angles"),
        View(results.tables["losses"], f"decision losses at the rule {MAIN}, by context"),
    ]


STUDY = Study(
    name="context",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view,
)
