"""L1 and KL in the place of the quadratic prior (thesis 4.3.1), trained in the 7x7 world.

The thesis argues against both without running them: L1 would match λR(α) exactly on most
state-action pairs and deviate sharply on others; KL would need a softmax, which distorts the
alignment. This study runs both as priors of a user, beside the quadratic one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure
from scipy.special import logsumexp

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.expert_demonstrations import MODES, trajectory_datasets
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import presets
from socialiq.learners.iq_learn.config import Hyperparameters, StaticConfig
from socialiq.learners.iq_learn.train import train
from socialiq.nn.q_policy import QPolicy
from socialiq.plotting.style import figure, plain
from socialiq.social.angle import score, weights
from socialiq.types import Ending, Row
from socialiq_lab.gridworld_runs import Ground, grid_of, pooled, rows_of
from socialiq_lab.results import Results
from socialiq_lab.study import Context, Findings, StageCallback, Study, view_of
from socialiq_lab.tables import column, groups, matching, mean, nested

STATIC = presets.GRID
CLOSE = 0.05
"""A deviation |r̂ - λR(α)| below this share of the largest |λR(α)| counts as a match."""


def l1(reward: Array, target: Array, strength: Array) -> Array:
    """Return E|r̂ - λR(α)|, the penalty that the thesis calls L1."""
    return jnp.mean(jnp.abs(reward - strength * target))


def kl(reward: Array, target: Array, strength: Array) -> Array:
    """Return KL(softmax(λR(α)) || softmax(r̂)), both over the rows of a batch."""
    prior, learned = jax.nn.log_softmax(strength * target), jax.nn.log_softmax(reward)
    return jnp.sum(jnp.exp(prior) * (prior - learned))


PENALTIES: dict[str, Callable[..., Any] | None] = {"quadratic": None, "l1": l1, "kl": kl}

_COLORS = ("#2166ac", "#c23b22", "#e08214")


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14)
    """Training seeds, each with its own data set."""
    strengths: tuple[float, ...] = (1.0, 3.0)
    """λ."""
    episodes_each: int = 60
    """Episodes of each expert."""
    updates: int = STATIC.updates
    """Gradient steps."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Train each penalty at every angle, strength and seed; evaluate exactly."""
    ground = Ground.of("crossing7")
    datasets = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    rows, gaps = [], []
    for name in PENALTIES:
        policies, deviating = _policy_rows(ground, config, name, datasets, context.on_stage)
        rows += policies
        gaps += deviating
    means = pooled(rows, ("penalty", "strength", "target_angle", "readout"))
    tables = {"policies": rows, "pooled": means, "deviations": gaps}
    return Findings(tables, _summary(tables))


def _policy_rows(
    ground: Ground,
    config: Config,
    name: str,
    datasets: Sequence[Demonstrations],
    on_stage: StageCallback,
) -> tuple[list[Row], list[Row]]:
    """Return the policies and the deviations of one penalty."""
    static = dataclasses.replace(STATIC, updates=config.updates)
    angles = list(MODES.values())
    runs = grid_of(angles, config.strengths, config.seeds, presets.TABLE_C1_NUMBERS)
    report = Callbacks(on_report=on_stage(f"7x7, {name}"))
    world = ground.table.world
    trained = train(static, runs, datasets, world, report, prior=PENALTIES[name])
    rows, gaps = [], []
    for number, run in enumerate(runs):
        label: Row = {"penalty": name, "strength": run.strength, "target_angle": run.angle}
        policy, data = trained.policy(number), datasets[run.dataset]
        rows += rows_of(ground, [policy], run.angle, label, [run.seed])
        gap = deviations(policy, static, run, data)
        gaps.append(label | {"seed": run.seed} | _deviation_row(gap, _target(STATIC, run, data)))
    return rows, gaps


def deviations(
    policy: QPolicy, static: StaticConfig, run: Hyperparameters, data: Demonstrations
) -> Float[np.ndarray, " transition"]:
    """Return r̂ - λR(α) of each demonstrated transition, with V(s') of the trained network."""
    q, after = policy.q_values(data.observation), policy.q_values(data.next_observation)
    tau = run.temperature
    value = tau * np.asarray(logsumexp(after / tau, axis=1))
    ended = np.asarray(data.ending) != int(Ending.NONE)  # the preset treats every end as zero
    taken = np.take_along_axis(q, data.action[:, None].astype(int), axis=1)[:, 0]
    reward = taken - run.discount * np.where(ended, 0.0, value)
    return reward - _target(static, run, data)


def _target(static: StaticConfig, run: Hyperparameters, data: Demonstrations) -> np.ndarray:
    """Return λR(α) of each transition."""
    pair = data.returns(static.target_kind, static.social_discount)
    return run.strength * np.asarray(score(weights(run.angle), pair))


def _deviation_row(gap: np.ndarray, target: np.ndarray) -> Row:
    """Return the distances of r̂ from λR(α), and how evenly they spread over transitions."""
    scale, size = float(np.abs(target).max()), np.abs(gap)
    level = gap - gap.mean()
    return {
        "matched": float((size <= CLOSE * scale).mean()),
        "median": float(np.median(size)),
        "mean": float(size.mean()),
        "largest": float(size.max()),
        # 1 if all deviations are equal; large if a few transitions deviate much more than the rest.
        "peakedness": float(size.max() / max(float(np.median(size)), 1e-12)),
        "level": float(gap.mean()),
        "correlation": float(np.corrcoef(target, target + level)[0, 1]),
    }


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Angle, regret and deviations by penalty, strength and target angle, and over all angles."""
    keys = ("penalty", "strength", "readout", "target_angle")
    summary = nested(tables["pooled"], *keys, keep=("angle", "regret", "arrival"))
    columns = ("matched", "median", "mean", "largest", "peakedness", "correlation")
    for (name, strength), gaps in groups(tables["deviations"], "penalty", "strength").items():
        entry = summary[name][f"{strength:g}"]
        for readout in ("greedy", "soft"):
            entry[readout]["mean_regret"] = mean(list(entry[readout].values()), "regret")
        entry["deviation"] = {name: mean(gaps, name) for name in columns}
    return summary


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw the mean deviation and the mean regret over target angles, by λ."""
    drawn = figure(8.4, 3.8)
    left, right = drawn.subplots(1, 2, sharex=True)
    gaps = results.tables["deviations"]
    regrets = matching(results.tables["pooled"], readout="soft")
    names = list(dict.fromkeys(column(gaps, "penalty")))
    for axes, rows, quantity in ((left, gaps, "matched"), (right, regrets, "regret")):
        strengths = sorted(set(column(rows, "strength")))
        for name, color in zip(names, _COLORS, strict=True):
            means = [
                mean(matching(rows, penalty=name, strength=strength), quantity)
                for strength in strengths
            ]
            axes.plot(strengths, means, marker="o", color=color, label=name)
        axes.set_xticks(strengths)
        plain(axes)
    left.set(xlabel="λ", ylabel="share of transitions at λR(α)")
    right.set(xlabel="λ", ylabel="regret at the target, soft policy")
    left.legend(frameon=False, fontsize=8)
    return {"penalties": drawn}


STUDY = Study(
    name="penalties",
    Config=Config,
    tables=compute_tables,
    figures=draw_figures,
    view=view_of("pooled"),
)
