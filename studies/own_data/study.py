"""Comparison of the defaults on logged data of environments that are not ours."""

import statistics
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import socialiq
from socialiq.errors import one_of
from socialiq.social.angle import exact_weights, score
from socialiq.types import RewardPair, Row
from socialiq_lab.jobs import Job, StageCallback, keeps_rows
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings, tracked
from socialiq_lab.tables import column, labelled, mean

MODULE = "studies.own_data.environments"
SETS: dict[str, Mapping[str, Any]] = declaration("own-data")["set"]
METHODS: dict[str, Mapping[str, Any]] = declaration("own-data")["method"]
BEST = "best demonstrator"
RANDOM = "random"
STATISTICS = {"share": statistics.fmean, "least": min, "most": max}
"""Columns of a set's shares, over the seeds."""


@dataclass(frozen=True)
class Comparison:
    """One set of logged episodes, and what is trained on it."""

    set: str
    methods: tuple[str, ...]
    angles: tuple[float, ...]
    seed: int
    logged: int
    episodes: int
    first_episode: int


def check(config: Any) -> None:
    """Refuse sets and methods that the declaration lacks."""
    for name in config.sets:
        one_of("set", name, tuple(SETS))
    for name in config.methods:
        one_of("method", name, tuple(METHODS))


def jobs(config: Any) -> list[Job]:
    """Return a job for each set and seed: log, train every method, evaluate."""
    numbers = config.logged, config.episodes, config.first_episode
    return [
        Job(
            f"{name}/{seed}",
            compare,
            Comparison(name, config.methods, config.angles, seed, *numbers),
            cost=200.0,
        )
        for name, seed in product(config.sets, config.seeds)
    ]


@keeps_rows
def compare(config: Comparison, _folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Log episodes of the rules, train every method on them, and evaluate each policy.

    Args:
        config: Set, methods, angles, seed, and numbers of episodes.
        on_stage: Shows the progress.

    Returns:
        Rows of J(α) of each policy, as "policies".
    """
    declared = SETS[config.set]
    world = declared["world"]
    drivers = {rule: f"python:{MODULE}:{rule}" for rule in declared["rules"]}
    logged = {"episodes": config.logged, "seed": config.seed, "allow_code": True}
    data = socialiq.collect(world, drivers, **logged)

    def returns(policy: Any) -> RewardPair:
        episodes = min(config.episodes, declared.get("episodes", config.episodes))
        where = {"episodes": episodes, "seed": config.first_episode, "allow_code": True}
        measured = socialiq.evaluate(policy, world, **where)
        return RewardPair(measured["r_env"], measured["r_social"])

    random = returns(RANDOM)
    of_rules = [returns(driver) for driver in drivers.values()]
    rows: list[Row] = []
    for angle in config.angles:
        weights = exact_weights(angle)
        label = {"set": config.set, "seed": config.seed, "angle": angle}
        rows.append(label | {"method": RANDOM, "value": score(weights, random)})
        best = max(score(weights, pair) for pair in of_rules)
        rows.append(label | {"method": BEST, "value": best})
    for name in tracked(config.methods, on_stage, "training", "methods"):
        method = METHODS[name]
        settings = dict(method.get("settings", {}))
        if not method.get("dial"):
            settings["angle"] = list(config.angles)
        trained = socialiq.train(method["learner"], data, seed=config.seed, **settings).trained
        if method.get("dial"):
            trained = [trained[0].at(angle) for angle in config.angles]
        for angle, policy in zip(config.angles, trained, strict=True):
            label = {"set": config.set, "seed": config.seed, "angle": angle}
            value = score(exact_weights(angle), returns(policy))
            rows.append(label | {"method": name, "value": value})
    return {"policies": rows}


def compute_tables(_config: Any, context: Context) -> Findings:
    """Return J(α) of every policy, and its share of the best demonstrator's gain over random.

    Args:
        context: Finished jobs and their work folder.

    Returns:
        Tables `policies` and `shares`, and an empty summary. Gains are summed over the angles,
        since at a single one random actions may be as good as the best demonstrator.
    """
    rows = context.tables()["policies"]
    totals = {
        (label["set"], label["seed"], label["method"]): mean(group, "value")
        for label, group in labelled(rows, "set", "seed", "method")
    }
    of_seeds: list[Row] = []
    for (name, seed, method), reached in totals.items():
        random = totals[name, seed, RANDOM]
        share = (reached - random) / (totals[name, seed, BEST] - random)
        of_seeds.append({"set": name, "seed": seed, "method": method, "share": share})
    shares = [
        label | {key: statistic(column(group, "share")) for key, statistic in STATISTICS.items()}
        for label, group in labelled(of_seeds, "set", "method")
    ]
    shares += [
        {"set": "mean", **label, **{key: mean(group, key) for key in STATISTICS}}
        for label, group in labelled(shares, "method")
    ]
    return Findings({"policies": rows, "shares": shares}, {})
