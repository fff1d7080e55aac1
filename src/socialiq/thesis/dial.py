"""The dial in the 7x7 world: one network for every angle, against the exact optimum of each."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.evaluation.dial_exact import (
    Sweep,
    ceiling_regrets,
    support_ceiling,
    sweep,
)
from socialiq.evaluation.exact import READOUTS, action_table
from socialiq.evaluation.rollout import rollout_totals
from socialiq.learners.dial.config import Numbers, Structure
from socialiq.learners.dial.train import Trained, train
from socialiq.learners.outside import Outside
from socialiq.mdp.front import AttainableSet
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import angle_difference, angle_of
from socialiq.social.dial import Setting, mixed_angle, mixture, setting
from socialiq.thesis.experts import trajectory_datasets
from socialiq.thesis.lanes import Ground, Watch, silent
from socialiq.thesis.store import Results, Row
from socialiq.worlds.grid_world import GridWorld

STUDY = "dial"
KEY_ANGLES = tuple(np.arange(0.0, 91.0, 15.0).tolist())


class Run(NamedTuple):
    """One way to train a dial.

    Attributes:
        structure: Its structure; what the network sees of the world is added.
        numbers: Its numbers; the seed is added.
        clock: Whether the world shows the time.
        support: Which actions an offline learner can know: at the time at which they were
            demonstrated ("timed"), or at any ("any time"); empty online.
    """

    structure: Structure
    numbers: Numbers
    clock: bool = True
    support: str = ""


_ONLINE = Structure(redraw_times=25, replay_batch=448)
_OFFLINE = Structure(online=False, scored="demonstrations")
# Chosen on training seeds 0 to 4 (docs/dial.md).
RUNS = {
    "online": Run(_ONLINE, Numbers()),
    "online-alone": Run(
        dataclasses.replace(_ONLINE, demonstrations=False, replay_batch=512), Numbers()
    ),
    "online-clockless": Run(
        dataclasses.replace(_ONLINE, redraw_times=0), Numbers(discount=0.99), clock=False
    ),
    "offline": Run(
        dataclasses.replace(_OFFLINE, updates=12_000),
        Numbers(prior_weight=50.0, temperature=0.03),
        support="timed",
    ),
    "offline-redrawn": Run(
        dataclasses.replace(_OFFLINE, updates=16_000, redraw_times=25),
        Numbers(prior_weight=200.0),
        support="any time",
    ),
}


@dataclass(frozen=True)
class Config:
    """What the study runs; the defaults are the committed results."""

    seeds: tuple[int, ...] = (30, 31, 32, 33, 34, 35, 36, 37, 38, 39)
    """Training seeds, each with a data set of its own. 0 to 9 were used in development."""
    episodes_each: int = 60
    """Demonstrated episodes of each expert."""
    runs: tuple[str, ...] = tuple(RUNS)
    """Which of `RUNS`."""
    updates: int | None = None
    """Gradient steps in place of each run's own; for trying the study out."""
    wanted: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 5.0).tolist())
    """Behavioural angles that the mixtures are to have."""
    rollouts: int = 1000
    """Episodes of each queried angle from which mixtures are estimated."""


def run(config: Config | None = None, watch: Watch = silent) -> Results:
    """Train every run, evaluate exactly at each degree, set the dial, and tabulate.

    Args:
        config: What to run.
        watch: Shows progress.
    """
    config = config or Config()
    ground = Ground.of("crossing7")
    tables: dict[str, list[Row]] = {"angles": [], "dials": [], "settings": []}
    files: dict[str, bytes] = {}
    data = {
        clock: trajectory_datasets(_with(ground, clock).table, config.seeds, config.episodes_each)
        for clock in (True, False)
    }
    ceilings = _ceilings(ground, config, data[True])
    for name in config.runs:
        trained = _train(ground, config, name, data[RUNS[name].clock], watch)
        for lane, seed in enumerate(config.seeds):
            one = _Judged(name, seed, trained.dial(lane), _with(ground, RUNS[name].clock))
            limit = ceilings.get((RUNS[name].support, seed), ground.optimum.attainable)
            for table, rows in one.rows(config, limit):
                tables[table] += rows
    tables["ceilings"] = _ceiling_rows(ground, config, ceilings)
    tables["pooled"] = _pooled(tables["dials"])
    tables["front"] = [
        {"r_env": float(env), "r_social": float(social)}
        for env, social in ground.optimum.attainable.front()
    ]
    kept = {name: rows for name, rows in tables.items() if rows}
    return Results.of(STUDY, config, kept, _summary(kept), files)


def _with(ground: Ground, clock: bool) -> Ground:
    """The same ground, whose world shows the time or doesn't."""
    if not clock:
        return ground
    table, part = (
        dataclasses.replace(one, world=one.world.with_clock())
        for one in (ground.table, ground.part)
    )
    return Ground(table, part, ground.optimum)


def seen(world: GridWorld) -> tuple[tuple[int, int], ...]:
    """What a network is told of a gridworld: smallest value and number of values by feature."""
    return tuple((feature.low, feature.size) for feature in world.observed)


def _train(
    ground: Ground, config: Config, name: str, data: Sequence[Demonstrations], watch: Watch
) -> Trained:
    structure, numbers, clock, _ = RUNS[name]
    world = _with(ground, clock).table.world
    structure = dataclasses.replace(
        structure, one_hot=seen(world), updates=config.updates or structure.updates
    )
    lanes = [
        dataclasses.replace(numbers, seed=seed, dataset=number)
        for number, seed in enumerate(config.seeds)
    ]
    return train(
        structure,
        lanes,
        data if structure.demonstrations else [],
        world if structure.online else None,
        outside=Outside(on_report=watch(f"7x7 dial, {name}")),
    )


class _Judged(NamedTuple):
    """One trained dial, and the rows that tell what it does."""

    name: str
    seed: int
    dial: DialPolicy
    ground: Ground

    def rows(self, config: Config, limit: AttainableSet) -> Iterator[tuple[str, list[Row]]]:
        """Rows by table. `limit` is what the run's support allows; everything online."""
        best = self.ground.optimum.attainable
        for readout in READOUTS:
            found = sweep(self.dial, self.ground.part, readout)
            label = {"run": self.name, "seed": self.seed, "readout": readout}
            yield "angles", _angle_rows(label, found, best)
            if readout == "greedy":
                settings = self._settings(label, config, found, limit)
                yield "settings", settings
                yield "dials", [_dial_row(label, found, best, limit, settings)]
            else:
                yield "dials", [_dial_row(label, found, best, limit, [])]

    def _settings(
        self, label: Row, config: Config, found: Sweep, limit: AttainableSet
    ) -> list[Row]:
        """The mixture for each wanted angle, exact and as rollouts have it."""
        best, points = self.ground.optimum.attainable, found.points
        totals = self._rollouts(config, found)
        estimated = np.array([one.mean(axis=0) for one in totals])
        rows = []
        for wanted in config.wanted:
            row = label | {"wanted": wanted} | dict.fromkeys(_SETTING, "")
            row |= {"share_of_radius": 0.0, "share_of_support": 0.0}
            if exact := _reached(points, wanted):
                row |= {
                    "first": found.angles[exact.first],
                    "second": found.angles[exact.second],
                    "share": exact.share,
                    "radius": exact.radius,
                    "share_of_radius": exact.radius / best.radius(wanted),
                    "share_of_support": exact.radius / limit.radius(wanted),
                }
            if guess := _reached(estimated, wanted):
                truly = mixture(points, guess)
                error = angle_difference(angle_of(*truly), wanted)
                interval = mixed_angle(
                    totals[guess.first], totals[guess.second], guess.share, self.seed
                )
                row |= {
                    "estimated_share": guess.share,
                    "estimated_angle_error": error,
                    "estimated_low": interval.low,
                    "estimated_high": interval.high,
                    "estimated_covers": int(interval.low <= wanted + error <= interval.high),
                    "estimated_share_of_radius": float(np.hypot(*truly)) / best.radius(wanted),
                }
            rows.append(row)
        return rows

    def _rollouts(self, config: Config, found: Sweep) -> list[np.ndarray]:
        """Totals of the episodes of each queried angle."""
        return [
            rollout_totals(
                self.ground.part,
                action_table(self.dial.at(angle), self.ground.part, "greedy"),
                config.rollouts,
                seed=1000 * self.seed + number,
            )
            for number, angle in enumerate(found.angles)
        ]


_SETTING = (
    "first",
    "second",
    "share",
    "radius",
    "share_of_radius",
    "share_of_support",
    "estimated_share",
    "estimated_angle_error",
    "estimated_low",
    "estimated_high",
    "estimated_covers",
    "estimated_share_of_radius",
)


def _reached(points: np.ndarray, angle: float) -> Setting | None:
    """The mixture of these policies at an angle, if there is one."""
    try:
        return setting(points, angle)
    except UserError:
        return None


def _angle_rows(label: Row, found: Sweep, best: AttainableSet) -> list[Row]:
    """Every fifth degree: where the dial leads and what it costs."""
    regrets = found.regrets(best)
    return [
        label
        | {"angle": angle}
        | one._asdict()
        | {"behavioural_angle": one.angle, "angle": angle, "regret": float(regret)}
        for angle, one, regret in zip(found.angles, found.metrics, regrets, strict=True)
        if angle % 5 == 0
    ]


def _dial_row(
    label: Row, found: Sweep, best: AttainableSet, limit: AttainableSet, settings: list[Row]
) -> Row:
    """One dial in numbers."""
    regrets = dict(zip(found.angles, found.regrets(best), strict=True))
    back = found.backward_steps()
    shares = [row["share_of_radius"] for row in settings]
    supported = [row["share_of_support"] for row in settings]
    errors = [abs(one) for row in settings if (one := row["estimated_angle_error"]) != ""]
    ceiling = np.mean(
        [best.optimum(angle).value - limit.optimum(angle).value for angle in KEY_ANGLES]
    )
    key = float(np.mean([regrets[angle] for angle in KEY_ANGLES]))
    return label | {
        "key_regret": key,
        "ceiling": float(ceiling),
        "above_ceiling": key - float(ceiling),
        "mean_regret": float(np.mean(list(regrets.values()))),
        "worst_regret": float(max(regrets.values())),
        "rise_r_env": back.env,
        "drop_r_social": back.social,
        "least_share_of_radius": min(shares) if shares else "",
        "least_share_of_support": min(supported) if supported else "",
        "mean_estimated_error": float(np.mean(errors)) if errors else "",
        "worst_estimated_error": max(errors) if errors else "",
    }


def _ceilings(
    ground: Ground, config: Config, data: Sequence[Demonstrations]
) -> dict[tuple[str, int], AttainableSet]:
    """What each data set's support allows, by kind of support and seed."""
    part = _with(ground, True).part
    wanted = {RUNS[name].support for name in config.runs} - {""}
    return {
        (support, seed): support_ceiling(one, part, timed=support == "timed")
        for support in sorted(wanted)
        for seed, one in zip(config.seeds, data, strict=True)
    }


def _ceiling_rows(
    ground: Ground, config: Config, ceilings: dict[tuple[str, int], AttainableSet]
) -> list[Row]:
    return [
        {"support": support, "seed": seed, "angle": angle, "regret": float(regret)}
        for (support, seed), ceiling in ceilings.items()
        for angle, regret in zip(
            config.wanted, ceiling_regrets(ceiling, ground.optimum, config.wanted), strict=True
        )
    ]


def _pooled(dials: list[Row]) -> list[Row]:
    """Mean, least and largest over seeds of every number of a run and readout."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in dials:
        groups.setdefault((row["run"], row["readout"]), []).append(row)
    rows = []
    for (name, readout), group in groups.items():
        row: Row = {"run": name, "readout": readout, "seeds": len(group)}
        for quantity in (key for key in group[0] if key not in ("run", "seed", "readout")):
            values = [one[quantity] for one in group if one[quantity] != ""]
            for what, of in (("mean", np.mean), ("low", min), ("high", max)):
                row[f"{quantity}_{what}"] = float(of(values)) if values else ""
        rows.append(row)
    return rows


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Pooled numbers by run and readout."""
    found: dict[str, Any] = {}
    for row in tables["pooled"]:
        entry = {key: value for key, value in row.items() if key not in ("run", "readout")}
        found.setdefault(row["run"], {})[row["readout"]] = entry
    return {"runs": found}
