"""The dial in the 7x7 world: one network for every angle, against the exact optimum of each."""

from pathlib import Path
from typing import Any

import numpy as np

from socialiq import UserError
from socialiq.evaluation.dial import Sweep, ceiling_regrets, support_ceiling, sweep
from socialiq.evaluation.exact import READOUTS, Ground, action_table
from socialiq.evaluation.rollout import rollout_totals, trajectory_datasets
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import PRESETS
from socialiq.mdp.front import AttainableSet
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social import dial as mixtures
from socialiq.social.angle import angle_difference, angle_of
from socialiq.storage import write_atomically
from socialiq.types import Row
from socialiq_lab.gridworld_runs import file_of, train_dials
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import column

KEY_ANGLES = tuple(np.arange(0.0, 91.0, 15.0).tolist())
"""Angles in degrees whose mean regret is the key regret of a dial."""
DIAL = "dial.safetensors"
"""File of the first run's first dial in the results folder: chosen before any was evaluated."""


def jobs(config: Any) -> list[Job]:
    """Return a job for each run, and one for each support of which there is a ceiling."""
    supports = sorted({PRESETS[name].support for name in config.runs} - {""})
    runs = [
        Job(f"dials/{name}", trained_dials, Part(config, name), cost=9.0) for name in config.runs
    ]
    return runs + [Job(f"ceilings/{kind}", ceiling_rows, Part(config, kind)) for kind in supports]


@keeps_rows
def trained_dials(part: Part, folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Train a run, evaluate it exactly at each degree, set its mixtures, write its first dial."""
    config = part.study
    preset = PRESETS[part.of]
    ground = Ground.of("crossing7").with_clock(preset.clock)
    data = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    limits = ceilings(config, preset.support) if preset.support else {}
    tables: dict[str, list[Row]] = {"angles": [], "dials": [], "settings": []}
    inputs = ground.table.world, config.seeds, data, config.updates, Callbacks(on_stage(part.of))
    trained = train_dials(preset, *inputs)
    write_atomically(folder / "dial", file_of(trained.policy(0)))
    for run, seed in enumerate(config.seeds):
        label = {"run": part.of, "seed": seed}
        limit = limits.get(seed, ground.optimum.attainable)
        _evaluate(tables, label, trained.policy(run), ground, config, limit)
    return tables


def ceilings(config: Any, support: str) -> dict[int, AttainableSet]:
    """Return the best values within the data's support, by the seed of the data."""
    clocked = Ground.of("crossing7").with_clock(True)
    data = trajectory_datasets(clocked.table, config.seeds, config.episodes_each)
    return {
        seed: support_ceiling(demonstrations, clocked.part, timed=support == "timed")
        for seed, demonstrations in zip(config.seeds, data, strict=True)
    }


@keeps_rows
def ceiling_rows(part: Part, _folder: Path, _on_stage: StageCallback) -> dict[str, list[Row]]:
    """Return the regret of the best values within a support, by seed and angle."""
    wanted = part.study.wanted
    optimum = Ground.of("crossing7").optimum
    rows = [
        {"support": part.of, "seed": seed, "angle": angle, "regret": float(regret)}
        for seed, ceiling in ceilings(part.study, part.of).items()
        for angle, regret in zip(wanted, ceiling_regrets(ceiling, optimum, wanted), strict=True)
    ]
    return {"ceilings": rows}


def compute_tables(config: Any, context: Context) -> Findings:
    """Return what the jobs have kept, the front, and the first run's first dial.

    Args:
        config: Configuration of the study.
        context: The finished jobs.
    """
    front = [
        {"r_env": float(env), "r_social": float(social)}
        for env, social in Ground.of("crossing7").optimum.attainable.front()
    ]
    file = context.work / "dials" / config.runs[0] / "dial"
    return Findings(context.tables() | {"front": front}, {}, {DIAL: file.read_bytes()})


def _evaluate(
    tables: dict[str, list[Row]],
    run: Row,
    dial: DialPolicy,
    ground: Ground,
    config: Any,
    limit: AttainableSet,
) -> None:
    """Add the rows of a dial to the tables; `limit` has the best values within its support."""
    best = ground.optimum.attainable
    for readout in READOUTS:
        label = run | {"readout": readout}
        swept = sweep(dial, ground.part, readout)
        regrets = dict(zip(swept.angles, swept.regrets(best).tolist(), strict=True))
        tables["angles"] += [
            label
            | {"angle": angle}
            | metrics._asdict()
            | {"behavioural_angle": metrics.angle, "angle": angle, "regret": regrets[angle]}
            for angle, metrics in zip(swept.angles, swept.metrics, strict=True)
            if angle % 5 == 0
        ]
        settings = (
            _settings(label, dial, ground, config, swept, limit) if readout == "greedy" else []
        )
        tables["settings"] += settings
        back = swept.backward_steps()
        shares = column(settings, "share_of_radius")
        supported = column(settings, "share_of_support")
        errors = [abs(error) for error in column(settings, "estimated_angle_error") if error != ""]
        key = float(np.mean([regrets[angle] for angle in KEY_ANGLES]))
        lost = [best.optimum(angle).value - limit.optimum(angle).value for angle in KEY_ANGLES]
        ceiling = float(np.mean(lost))
        tables["dials"].append(
            label
            | {"key_regret": key, "ceiling": ceiling, "above_ceiling": key - ceiling}
            | {"mean_regret": float(np.mean(list(regrets.values())))}
            | {"worst_regret": max(regrets.values())}
            | {"rise_r_env": back.env, "drop_r_social": back.social}
            | {"least_share_of_radius": min(shares) if shares else ""}
            | {"least_share_of_support": min(supported) if supported else ""}
            | {"mean_estimated_error": float(np.mean(errors)) if errors else ""}
            | {"worst_estimated_error": max(errors) if errors else ""}
        )


_SETTING = (
    "first", "second", "share", "radius", "share_of_radius", "share_of_support",
    "estimated_share", "estimated_angle_error", "estimated_low", "estimated_high",
    "estimated_covers", "estimated_share_of_radius",
)  # fmt: skip


def _settings(
    label: Row, dial: DialPolicy, ground: Ground, config: Any, swept: Sweep, limit: AttainableSet
) -> list[Row]:
    """Return the mixture for each wanted angle, exact and estimated from rollouts."""
    best = ground.optimum.attainable
    points = swept.points
    seed = label["seed"]
    totals = [
        rollout_totals(
            ground.part,
            action_table(dial.at(angle), ground.part, "greedy"),
            config.rollouts,
            seed=1000 * seed + number,
        )
        for number, angle in enumerate(swept.angles)
    ]
    estimated = np.array([episodes.mean(axis=0) for episodes in totals])
    rows = []
    for wanted in config.wanted:
        row = label | {"wanted": wanted} | dict.fromkeys(_SETTING, "")
        row |= {"share_of_radius": 0.0, "share_of_support": 0.0}
        if exact := _reached(points, wanted):
            row |= {
                "first": swept.angles[exact.first],
                "second": swept.angles[exact.second],
                "share": exact.share,
                "radius": exact.radius,
                "share_of_radius": exact.radius / best.radius(wanted),
                "share_of_support": exact.radius / limit.radius(wanted),
            }
        if guess := _reached(estimated, wanted):
            achieved = mixtures.mixture(points, guess)
            error = angle_difference(angle_of(*achieved), wanted)
            pair = totals[guess.first], totals[guess.second]
            interval = mixtures.mixed_angle(*pair, guess.share, seed)
            row |= {
                "estimated_share": guess.share,
                "estimated_angle_error": error,
                "estimated_low": interval.low,
                "estimated_high": interval.high,
                "estimated_covers": int(interval.low <= wanted + error <= interval.high),
                "estimated_share_of_radius": float(np.hypot(*achieved)) / best.radius(wanted),
            }
        rows.append(row)
    return rows


def _reached(points: np.ndarray, angle: float) -> mixtures.Setting | None:
    """Return the mixture of these policies at an angle, or None without one."""
    try:
        return mixtures.setting(points, angle)
    except UserError:
        return None
