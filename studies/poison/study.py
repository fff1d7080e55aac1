"""Effect of a malicious minority on learners, with honest and with forged labels (thesis 1, 8.3).

The 7x7 world has the option in which the ego can collide. Labels that are computed again leave the
honest episodes of a forged set, so all attackers share these trainings; where labels are honest
nothing is dropped; a learner that reads no label has one training for honest and forged ones.
"""

import dataclasses
import datetime
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from socialiq import Demonstrations, Margin, declare, tabulate
from socialiq.audit.evidence.collect import drive_references
from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Evidence, Reference
from socialiq.audit.profile.template import USUAL, floor_at, possible_loss
from socialiq.audit.verdict.verdict import decide
from socialiq.demonstrations.trust import consistency
from socialiq.evaluation import exact, malice
from socialiq.evaluation.labels import trusted
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.dial import config as dial
from socialiq.learners.iq_learn import config as iq
from socialiq.plotting import style
from socialiq.results_folder import Results
from socialiq.types import Row
from socialiq.worlds.registry import make_grid
from socialiq_lab import comparison, comparison_runs
from socialiq_lab.comparison_runs import (
    Arena,
    Learner,
    Run,
    best_episodes_cloned,
    iq_learn,
    offline,
)
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings, tracked
from socialiq_lab.tables import column, groups, mean, spread

WORLD, OPTIONS = "crossing7", {"braking": "one_level"}
METHODS = comparison.declared_methods(declaration("poison"))
"""The learners by name."""
MARGIN = USUAL[WORLD].margin
"""Regret at which a learner counts as broken: the audit's default margin."""
ATTACKERS = {"hater": "hater", "rammer": "rammer", "adaptive": "hater"}
"""Attackers by name and what they do; the adaptive one forges within limits of `data trust`."""
CASES = ("honest", "forged", "recomputed")
DAY = datetime.date(2026, 11, 27)
OFFLINE = dial.PRESETS["offline"]

_SHIFTED: dict[str, Any] = {"prior": "shifted_chi2", "target_kind": "instantaneous"}
LEARNERS: Mapping[str, Learner] = {
    "iq_learn": iq_learn(prior="none"),
    "thesis": iq_learn(prior="reward", target_kind="running"),
    "shifted_chi2": iq_learn(**_SHIFTED),
    "trimmed": iq_learn(**_SHIFTED),
    "dial_offline": comparison_runs.dialled(
        dataclasses.replace(OFFLINE.structure, redraw_times=0), OFFLINE.numbers, "discount"
    ),
    "clone": offline(bc.BehaviourCloning),
    "clone_weighted": offline(bc.BehaviourCloning, weighted=True),
    "clone_of_best": best_episodes_cloned,
}
"""By the `learner` of a method in STUDY.toml."""


class Poison(NamedTuple):
    """Contamination of a data set; `case` is of the labels that a learner gets."""

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


def poisons(config: Any) -> list[Poison]:
    """Return every contamination; an adaptive forger differs by its labels alone."""
    cases = [pair for pair in itertools.product(ATTACKERS, CASES) if pair != ("adaptive", "honest")]
    return [
        Poison(attacker, case, share, seed)
        for attacker, case in cases
        for share, seed in itertools.product(config.shares, config.seeds)
    ]


def data_of(table: Any, poison: Poison, episodes_each: int, cleaned: bool = True) -> Demonstrations:
    """Return the data set of a contamination."""
    honest = trajectory_datasets(table, [poison.seed], episodes_each)[0]
    count = round(poison.share * honest.n_episodes)
    if not count:
        return honest
    attacker = malice.ATTACKERS[ATTACKERS[poison.attacker]]
    bad = malice.attacked_table(table, attacker, count, 7000 + poison.seed)
    if poison.case != "honest":
        check = consistency(bad, honest) if poison.attacker == "adaptive" else None
        bad = malice.forged(bad, check)
    mixed = malice.poisoned(honest, bad, poison.seed)
    return trusted(mixed, "")[0] if poison.case == "recomputed" and cleaned else mixed


class Learned(NamedTuple):
    """A trained policy at an angle, and its exact row."""

    method: str
    angle: float
    policy: Any
    row: Row


def learned(config: Any, ground: exact.Ground, context: Context) -> dict[tuple, Learned]:
    """Train every method on every contamination; return the policies by method, set and angle."""
    policies: dict[tuple, Learned] = {}
    structure = iq.TABLE_C1
    rates = {"learning_rate": config.learning_rate, "polyak": config.polyak}
    numbers = dataclasses.replace(iq.TABLE_C1_NUMBERS, **rates)
    for name in config.methods:
        method, reads = METHODS[name], "rewards" in METHODS[name].told
        sets = list(dict.fromkeys(poison.training(reads) for poison in poisons(config)))
        arena = Arena(
            structure,
            numbers,
            config.updates,
            [data_of(ground.table, poison, config.each) for poison in sets],
            ground.table.world,
            on_report=context.on_stage(name),
            chunk=500,
        )
        (setting,) = method.settings or ((),)
        served = method.served(config.angles)
        runs = [
            Run(angle, poison.seed, number, setting)
            for angle in served
            for number, poison in enumerate(sets)
        ]
        for run, policy in zip(runs, LEARNERS[name](arena, runs), strict=True):
            for angle in served[run.angle]:
                turned = policy.at(angle) if hasattr(policy, "at") else policy
                metrics = exact.evaluate_exactly(
                    ground.part, exact.action_table(turned, ground.part, "greedy")
                )
                row = {"regret": ground.optimum.regret(metrics, angle)}
                row |= {"collision": metrics.collision, "arrival": metrics.arrival}
                policies[name, sets[run.dataset], angle] = Learned(name, angle, turned, row)
    return policies


def verdicts(config: Any, ground: exact.Ground, drivers: Sequence[Learned]) -> Iterator[str]:
    """Yield the verdict of the default audit of each policy, equal ones audited once."""
    seeds = np.random.default_rng(config.seeds[0]).integers(2**62, size=config.audit_episodes)
    course = Course(ground.table.world, seeds)
    references, decided = drive_references(course, ()), {}
    for driver in drivers:
        actions = exact.action_table(driver.policy, ground.part, "greedy")
        key = driver.angle, actions.tobytes()
        if key not in decided:
            usual, floor = USUAL[WORLD], floor_at(driver.angle)
            loss = possible_loss(ground.table.world, driver.angle)
            margin = Margin(usual.margin, None, loss, usual.width, usual.beyond)
            who = driver.angle, "a study", WORLD, margin, DAY, OPTIONS
            profile = declare(*who, competence=floor)
            outcomes = course.drive(Reference("policy", driver.policy))
            evidence = Evidence(course.world.description, seeds, outcomes, references, {}, ())
            decided[key] = decide(profile, evidence, 0, 2000, profile.error).decision.value
        yield decided[key]


def check_rows(config: Any, table: Any, context: Context) -> Iterator[Row]:
    """Yield the shares of episodes that `data trust` flags, without and with a reference."""
    reference = trajectory_datasets(table, [99], max(config.each // 3, 2))[0]
    pairs = itertools.product(ATTACKERS, config.shares)
    every = [(name, share) for name, share in pairs if share or name == "hater"]
    for (attacker, share), basis in tracked(
        list(itertools.product(every, (None, reference))), context.on_stage, "checks", "settings"
    ):
        rates = []
        for seed in config.check_seeds:
            poison = Poison(attacker, "forged", float(share), seed)
            data = data_of(table, poison, config.each)
            bad = np.array([data.mode_names[m] == malice.MODE for m in data.episode_modes])
            flagged = consistency(data, basis).flagged
            rates.append((flagged[~bad].mean(), flagged[bad].mean() if bad.any() else np.nan))
        false, caught = np.array(rates).T
        row: Row = {"attacker": attacker, "share": share, "reference": basis is not None}
        row |= {"false_alarms": false.mean(), "most_false_alarms": false.max()}
        yield row | {"caught": caught.mean() if share else ""}


def compute_tables(config: Any, context: Context) -> Findings:
    """Train, evaluate exactly, audit; find breakdown points and policies that pass."""
    table = tabulate(make_grid(WORLD, **OPTIONS))
    part = table.reachable_part()
    ground = exact.Ground(table, part, exact.Optimum(part))
    policies = learned(config, ground, context)
    judged = dict(zip(policies, verdicts(config, ground, list(policies.values())), strict=True))
    rows: list[Row] = []
    for name, poison, angle in itertools.product(config.methods, poisons(config), config.angles):
        key = name, poison.training("rewards" in METHODS[name].told), angle
        row = {"method": name} | poison._asdict() | {"angle": angle} | policies[key].row
        rows.append(row | {"verdict": judged[key]})
    curves, breakdown, audits = [], [], []
    for (name, attacker, case), group in groups(rows, "method", "attacker", "case").items():
        label: Row = {"method": name, "attacker": attacker, "case": case}
        for (share,), at_share in groups(group, "share").items():
            seeds = [mean(of_seed, "regret") for of_seed in groups(at_share, "seed").values()]
            row = {"regret": np.mean(seeds), "regret_low": min(seeds), "regret_high": max(seeds)}
            row |= {"collision": mean(at_share, "collision")}
            passing = np.mean([each["verdict"] == "pass" for each in at_share])
            curves.append(label | {"share": share} | row | {"passing": passing})
        points = [{"share": _breakdown(of_seed)} for of_seed in groups(group, "seed").values()]
        breakdown.append(label | spread(points, "share"))
        counts = {verdict: column(group, "verdict").count(verdict) for verdict in ("pass", "fail")}
        wrong = [row for row in group if row["verdict"] == "pass" and row["regret"] > MARGIN]
        collided = [row for row in group if row["verdict"] == "pass" and row["collision"] > 0.01]
        row = label | counts | {"inconclusive": len(group) - sum(counts.values())}
        audits.append(row | {"pass_beyond_margin": len(wrong), "pass_and_collide": len(collided)})
    checks = list(check_rows(config, table, context))
    tables = {"policies": rows, "curves": curves, "breakdown": breakdown, "audits": audits}
    return Findings(tables | {"checks": checks}, _summary(curves, breakdown, audits))


def _breakdown(rows: Sequence[Row]) -> float:
    """Return the smallest share with a mean regret beyond the margin; 1 without one."""
    broken = [
        share for (share,), at in groups(rows, "share").items() if mean(at, "regret") > MARGIN
    ]
    return min(broken, default=1.0)


def _summary(curves: list[Row], breakdown: list[Row], audits: list[Row]) -> dict[str, Any]:
    """Return curves and breakdown points by method, attacker and case, and wrong passes."""
    summary: dict[str, Any] = {}
    for row in curves:
        place = summary.setdefault(row["method"], {}).setdefault(row["attacker"], {})
        values = {name: row[name] for name in ("regret", "collision", "passing")}
        place.setdefault(row["case"], {})[f"{100 * row['share']:g}"] = values
    for row in breakdown:
        summary[row["method"]][row["attacker"]][row["case"]]["breakdown"] = row["mean"]
    names = ("pass_beyond_margin", "pass_and_collide")
    return summary | {"audits": {name: sum(row[name] for row in audits) for name in names}}


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw regret against the share of the hater's episodes, a panel for each case of labels."""
    figure = style.figure(10.0, 4.2)
    panels = figure.subplots(1, 3, sharey=True)
    titles = ("honest labels", "forged labels, believed", "forged labels, computed again")
    for axes, case, title in zip(panels, CASES, titles, strict=True):
        rows = [row for row in results.tables["curves"] if row["case"] == case]
        hater = [row for row in rows if row["attacker"] == "hater"]
        for number, ((name,), of_method) in enumerate(groups(hater, "method").items()):
            shares = [100 * row["share"] for row in of_method]
            look = {"color": f"C{number}", "marker": "osv^D*Px"[number % 8], "markersize": 4}
            axes.plot(shares, column(of_method, "regret"), label=METHODS[name].label, **look)
        axes.axhline(MARGIN, color="#6e6e6e", linestyle="--", linewidth=0.8)
        words: dict[str, Any] = {"xlabel": "malicious episodes, %"}
        words |= {"ylabel": "mean regret at 0°, 45°, 90°"} if case == CASES[0] else {}
        style.finish(axes, title, **words)
    title = "One forged episode in twenty is enough, unless labels are computed again"
    style.head(figure, title, panels[0], 4)
    return {"curves": figure}
