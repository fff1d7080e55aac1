"""L1 and KL in the place of the quadratic prior (thesis 4.3.1), trained in the 7x7 world.

The thesis argues against both without running them: L1 would match λR(α) exactly on most
state-action pairs and leave it sharply on others; KL would need a softmax, which distorts the
alignment. Here both are run as a user's own priors, beside the quadratic and the baseline.
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
from scipy.special import logsumexp

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.expert_demonstrations import MODES, trajectory_datasets
from socialiq.experiments.gridworld_runs import Ground, grid_of, pooled, rows_of
from socialiq.experiments.study import Context, Findings, StageCallback
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import presets
from socialiq.learners.iq_learn.config import Hyperparameters, StaticConfig
from socialiq.learners.iq_learn.train import train
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score, weights
from socialiq.types import Ending, Row

KEYS = ("penalty", "strength", "target_angle", "readout")
STRUCTURE = presets.GRID
CLOSE = 0.05
"""A deviation |r̂ - λR(α)| below this share of the largest |λR(α)| counts as a match."""


def l1(reward: Array, target: Array, strength: Array) -> Array:
    """E|r̂ - λR(α)|: the penalty that the thesis calls L1."""
    return jnp.mean(jnp.abs(reward - strength * target))


def kl(reward: Array, target: Array, strength: Array) -> Array:
    """KL(softmax(λR(α)) || softmax(r̂)), both over the rows of a batch."""
    wanted, given = jax.nn.log_softmax(strength * target), jax.nn.log_softmax(reward)
    return jnp.sum(jnp.exp(wanted) * (wanted - given))


PENALTIES: dict[str, Callable[..., Any] | None] = {"quadratic": None, "l1": l1, "kl": kl}


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14)
    """Training seeds, each with a data set of its own."""
    strengths: tuple[float, ...] = (1.0, 3.0)
    """λ."""
    episodes_each: int = 60
    """Episodes of each expert."""
    updates: int = STRUCTURE.updates
    """Gradient steps."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Train each penalty at every angle, strength and seed; evaluate exactly."""
    ground = Ground.of("crossing7")
    datasets = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    rows, gaps = [], []
    for name in PENALTIES:
        found = _trained(ground, config, name, datasets, context.on_stage)
        rows += found[0]
        gaps += found[1]
    tables = {"policies": rows, "pooled": pooled(rows, KEYS), "deviations": gaps}
    return Findings(tables, _summary(tables))


def _trained(
    ground: Ground,
    config: Config,
    name: str,
    datasets: Sequence[Demonstrations],
    on_stage: StageCallback,
) -> tuple[list[Row], list[Row]]:
    """Return the policies and the deviations of one penalty."""
    structure = dataclasses.replace(STRUCTURE, updates=config.updates)
    angles = list(MODES.values())
    numbers = grid_of(angles, config.strengths, config.seeds, presets.TABLE_C1_NUMBERS)
    report = Callbacks(on_report=on_stage(f"7x7, {name}"))
    world = ground.table.world
    trained = train(structure, numbers, datasets, world, report, prior=PENALTIES[name])
    rows, gaps = [], []
    for run, one in enumerate(numbers):
        label: Row = {"penalty": name, "strength": one.strength, "target_angle": one.angle}
        policy = trained.policy(run)
        rows += rows_of(ground, [policy], one.angle, label, [one.seed])
        found = deviations(policy, structure, one, datasets[one.dataset])
        gaps.append(label | {"seed": one.seed} | _of_deviations(found, one, datasets[one.dataset]))
    return rows, gaps


def deviations(
    policy: QPolicy, structure: StaticConfig, numbers: Hyperparameters, data: Demonstrations
) -> Float[np.ndarray, " transition"]:
    """Return r̂ - λR(α) of each demonstrated transition, with V(s') of the trained network."""
    q, after = policy.q_values(data.observation), policy.q_values(data.next_observation)
    tau = numbers.temperature
    value = tau * np.asarray(logsumexp(after / tau, axis=1))
    ended = np.asarray(data.ending) != int(Ending.NONE)  # the preset treats every end as zero
    taken = np.take_along_axis(q, data.action[:, None].astype(int), axis=1)[:, 0]
    reward = taken - numbers.discount * np.where(ended, 0.0, value)
    return reward - _target(structure, numbers, data)


def _target(structure: StaticConfig, numbers: Hyperparameters, data: Demonstrations) -> np.ndarray:
    pair = data.returns(structure.target_kind, structure.social_discount)
    return numbers.strength * np.asarray(score(weights(numbers.angle), pair))


def _of_deviations(gap: np.ndarray, numbers: Hyperparameters, data: Demonstrations) -> Row:
    """Return the distances of r̂ from λR(α), and how unevenly transitions share them."""
    target = _target(STRUCTURE, numbers, data)
    scale, size = float(np.abs(target).max()), np.abs(gap)
    level = gap - gap.mean()
    return {
        "matched": float((size <= CLOSE * scale).mean()),
        "median": float(np.median(size)),
        "mean": float(size.mean()),
        "largest": float(size.max()),
        # 1 if all deviate alike, towards infinity if few carry all of it.
        "peakedness": float(size.max() / max(float(np.median(size)), 1e-12)),
        "level": float(gap.mean()),
        "correlation": float(np.corrcoef(target, target + level)[0, 1]),
    }


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Angle, regret and deviations by penalty, strength and target angle, and over all angles."""
    found: dict[str, Any] = {}
    for row in tables["pooled"]:
        entry = found.setdefault(row["penalty"], {}).setdefault(f"{row['strength']:g}", {})
        entry.setdefault(row["readout"], {})[f"{row['target_angle']:g}"] = {
            "angle": row["angle"],
            "regret": row["regret"],
            "arrival": row["arrival"],
        }
    for name, strengths in found.items():
        for strength, entry in strengths.items():
            rows = [
                row
                for row in tables["deviations"]
                if row["penalty"] == name and f"{row['strength']:g}" == strength
            ]
            columns = ("matched", "median", "mean", "largest", "peakedness", "correlation")
            entry["deviation"] = {
                column: float(np.mean([row[column] for row in rows])) for column in columns
            }
            for readout in ("greedy", "soft"):
                regrets = [one["regret"] for one in entry[readout].values()]
                entry[readout]["mean_regret"] = float(np.mean(regrets))
    return found
