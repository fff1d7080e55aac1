"""Unlikeness by shift, and collisions where another driver decides in unlike states.

The score is that of `socialiq unlikeness`, compared with the disagreement of several dials.
"""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import mannwhitneyu

from socialiq.evaluation.episodes import episodes_of, outcome_row
from socialiq.evaluation.simulate import Watched, observations_of
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.unlikeness import USUAL_RATE, Unlikeness
from socialiq.social.angle import exact_weights, score
from socialiq.statistics.intervals import normal_mean
from socialiq.storage import packaged_results
from socialiq.types import Row
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from socialiq_lab.study import tracked

STOP = "wait"
CHANCE = "stops by chance"
"""A fallback, and the same in as many decisions whatever is observed."""


def disagreement(members: list[QPolicy], rows: np.ndarray) -> np.ndarray:
    """Return the largest deviation of an action's advantage among policies.

    Args:
        members: Policies whose values are compared.
        rows: Observations, (row, feature); each member reads as many features as it has.

    Returns:
        Standard deviation among the members of the value less its mean over actions, the largest
        over actions, (row,).
    """
    values = np.array([member.q_values(rows[:, : member.n_features]) for member in members])
    return (values - values.mean(axis=2, keepdims=True)).std(axis=0).max(axis=1)


def scores_of(policy: QPolicy, members: list[QPolicy], rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return both scores of observations.

    Args:
        policy: Policy with a fitted unlikeness.
        members: Policies whose disagreement is the second score.
        rows: Observations, (row, feature).

    Returns:
        Scores "features" and "ensemble", each (row,).
    """
    assert policy.unlikeness is not None
    density = policy.unlikeness(policy.features(rows))
    return {"features": density, "ensemble": disagreement(members, rows)}


def driven(shift: str, driver: Watched, angle: float, seeds: np.ndarray) -> Row:
    """Return the share of the decisions by the fallback, endings and J(α) of episodes.

    Args:
        shift: Name of the shift.
        driver: Policy with its fallback.
        angle: α in degrees of J(α).
        seeds: Seed of each episode.
    """
    episodes = episodes_of(Intersection().shifted(shift).batch(len(seeds)), driver, seeds)
    value = normal_mean("value", score(exact_weights(angle), episodes.totals))
    return {"share": driver.share} | outcome_row(episodes) | value


def fallback_rows(config: Any, dial: DialPolicy, policy: QPolicy, *cell: Any) -> Iterator[Row]:
    """Yield the outcomes of each fallback at each rate, from none of the decisions to all.

    Args:
        config: Configuration of the study; `fallbacks` and `rates` are read.
        dial: Dial that serves a fallback which is an angle.
        policy: Policy that drives, with a fitted unlikeness.
        *cell: Shift, angle in degrees, and seeds of the episodes.

    Yields:
        A row for each fallback and rate; `STOP` has a further row for stops by chance.
    """

    def chance(share: float) -> Any:
        rng = np.random.default_rng(0)
        return lambda rows: rng.random(len(rows)) < share

    for name in config.fallbacks:
        rule = name in Intersection().drivers
        instead = Intersection().driver(name) if rule else dial.at(float(name))
        for rate in (0.0, *config.rates, 1.0):
            alarm = policy.alarm(rate) if 0.0 < rate < 1.0 else chance(rate)
            row = driven(cell[0], Watched(policy, alarm, instead), *cell[1:])
            yield {"fallback": name, "rate": rate} | row
            if name == STOP:
                watched = Watched(policy, chance(row["share"]), instead)
                yield {"fallback": CHANCE, "rate": rate} | driven(cell[0], watched, *cell[1:])


def jobs(config: Any) -> list[Job]:
    """Return a job for each angle."""
    return [Job(f"shifts/{angle:g}", of_angle, Part(config, angle)) for angle in config.angles]


@keeps_rows
def of_angle(part: Part, _folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Fit the score at an angle, compare both by shift, and drive with each fallback."""
    config = part.study
    angle = part.of
    dials = [DialPolicy.load(packaged_results() / name) for name in config.dials]
    blocks = np.array(config.blocks)[:, None] + np.arange(config.episodes)
    separation = list[Row]()
    fallback = list[Row]()
    members = [dial.at(angle) for dial in dials]
    plain = Intersection().batch(config.episodes)
    fit, known = (observations_of(plain, members[0], block) for block in blocks[:2])
    density = Unlikeness.fit(members[0].features(fit), members[0].features(known))
    policy = dataclasses.replace(members[0], unlikeness=density)
    usual = scores_of(policy, members, known)
    for shift in tracked(config.shifts, on_stage, f"{angle:g} degrees", "shifts"):
        batch = Intersection().shifted(shift).batch(config.episodes)
        label = Row(shift=shift)
        label |= {"angle": angle}
        row = dict(label)
        rows = observations_of(batch, policy, blocks[2])
        for name, distance in scores_of(policy, members, rows).items():
            area = mannwhitneyu(distance, usual[name]).statistic
            threshold = np.quantile(usual[name], 1.0 - USUAL_RATE, method="higher")
            row |= {f"{name}_area": float(area / len(distance) / len(usual[name]))}
            row |= {f"{name}_share": float((distance > threshold).mean())}
        separation.append(row)
        if shift in config.fallback_shifts:
            rows = fallback_rows(config, dials[0], policy, shift, angle, blocks[2])
            fallback += [label | row for row in rows]
    return {"separation": separation, "fallback": fallback}
