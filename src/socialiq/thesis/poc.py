"""The 5x5 proof of concept (thesis 6.1, Fig 6.1): action sequences of baseline and targets."""

from __future__ import annotations

import dataclasses
from collections import Counter
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import equal_trajectories
from socialiq.evaluation.exact import action_table
from socialiq.learners.iq_learn.config import Structure
from socialiq.thesis import presets
from socialiq.thesis.experts import MODES, expert_pools
from socialiq.thesis.lanes import Ground, Watch, grid_of, silent, train_lanes
from socialiq.thesis.store import Results, Row
from socialiq.worlds.enumerate import Table
from socialiq.worlds.experts import expert_policy

STUDY = "poc"
THESIS = {
    "baseline": "WWWWGGGG",
    "egoistic": "GGGG",
    "prosocial": "WGGGG",
    "altruistic": "WWWWGGGG",
}


@dataclass(frozen=True)
class Config:
    """What the study runs; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14, 15, 16, 17, 18, 19)
    """Training seeds; 0 to 9 were used in development."""
    strength: float = presets.POC_STRENGTH
    """λ."""
    updates: int = presets.POC.updates
    """Gradient steps of the figure."""
    readings: bool = True
    """Whether to train the other readings of "cumulative" and of V(s') too."""


def run(config: Config | None = None, watch: Watch = silent) -> Results:
    """Train, read the greedy action sequences, and tabulate.

    Args:
        config: What to run.
        watch: Shows progress.
    """
    config = config or Config()
    ground = Ground.of("crossing5")
    data = equal_trajectories(expert_pools(ground.table, dict.fromkeys(MODES, 1), 0), 1, 0)
    structures = [dataclasses.replace(presets.POC, updates=config.updates)]
    if config.readings:
        structures = [
            dataclasses.replace(structures[0], target_kind=kind, next_value=value)
            for kind in ("running", "to_go", "trajectory", "instantaneous")
            for value in ("online", "target")
        ]
    rows = [row for one in structures for row in _rows(ground, one, config, data, watch)]
    tables = {
        "experts": _expert_rows(ground.table),
        "sequences": rows,
        "agreement": _agreement(rows),
    }
    return Results.of(STUDY, config, tables, _summary(tables, structures[0]))


def sequence(table: Table, policy: Float[np.ndarray, "state action"]) -> str:
    """The actions of one greedy episode in the deterministic world, W for Wait and G for Go."""
    mdp, letters = table.mdp, ""
    state = int(mdp.initial.argmax())
    for _ in range(table.world.horizon):
        action = int(policy[state].argmax())
        letters += table.world.actions[action][0]
        if mdp.ending[state, action, 0]:
            break
        state = int(mdp.successor[state, action, 0])
    return letters


def _rows(
    ground: Ground, structure: Structure, config: Config, data: Demonstrations, watch: Watch
) -> list[Row]:
    """Baseline and targets of one reading; every seed learns from the one data set there is."""
    name = f"5x5 {structure.target_kind}, V(s') {structure.next_value}"
    lanes = {
        "baseline": (presets.baseline(structure), [0.0]),
        "targets": (structure, list(MODES.values())),
    }
    rows = []
    for stage, (one, angles) in lanes.items():
        numbers = [
            dataclasses.replace(each, dataset=0)
            for each in grid_of(angles, [config.strength], config.seeds, presets.TABLE_C1_NUMBERS)
        ]
        trained = train_lanes(ground, one, numbers, [data], watch(f"{name}, {stage}"))
        modes = ["baseline"] if stage == "baseline" else list(MODES)
        for lane, each in enumerate(numbers):
            policy = action_table(trained.policy(lane), ground.table, "greedy")
            mode = modes[lane // len(config.seeds)]
            found = sequence(ground.table, policy)
            rows.append(
                {
                    "policy": mode,
                    "target_kind": structure.target_kind,
                    "next_value": structure.next_value,
                    "seed": each.seed,
                    "sequence": found,
                    "thesis": THESIS[mode],
                    "equal": int(found == THESIS[mode]),
                }
            )
    return rows


def _expert_rows(table: Table) -> list[Row]:
    return [
        {
            "mode": mode,
            "angle": angle,
            "sequence": sequence(table, expert_policy(table, angle)),
            "thesis": THESIS[mode],
        }
        for mode, angle in MODES.items()
    ]


def _agreement(rows: list[Row]) -> list[Row]:
    """Seeds that show the thesis' sequence, and the commonest sequence, by reading and policy."""
    keys = ("target_kind", "next_value", "policy")
    groups: dict[tuple, list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    table = []
    for values, group in groups.items():
        commonest, count = Counter(row["sequence"] for row in group).most_common(1)[0]
        table.append(
            dict(zip(keys, values, strict=True))
            | {"seeds": len(group), "equal": sum(row["equal"] for row in group)}
            | {"commonest": commonest, "commonest_seeds": count, "thesis": group[0]["thesis"]}
        )
    return table


def _summary(tables: dict[str, list[Row]], structure: Structure) -> dict:
    """The figure's reading by policy, and how many seeds show all four sequences together."""
    kind, value = structure.target_kind, structure.next_value
    chosen = [
        row
        for row in tables["agreement"]
        if (row["target_kind"], row["next_value"]) == (kind, value)
    ]
    together: dict[int, list[int]] = {}
    for row in tables["sequences"]:
        if (row["target_kind"], row["next_value"]) == (kind, value):
            together.setdefault(row["seed"], []).append(row["equal"])
    return {
        "policies": {row["policy"]: row for row in chosen},
        "experts": {row["mode"]: row["sequence"] for row in tables["experts"]},
        "seeds": len(together),
        "all_four": sum(all(equal) for equal in together.values()),
    }
