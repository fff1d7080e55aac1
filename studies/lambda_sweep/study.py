"""Adaptation in the λ sweep: updates until a run's angle stays near the optimum's (Fig D.1)."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.plotting.thesis import WITHIN, adaptation, settled
from socialiq.results_folder import Results
from socialiq.social.angle import angle_difference, angle_of
from socialiq.types import Row
from socialiq_lab.declared import State
from socialiq_lab.tables import column, labelled, matching

KEYS = ("target_kind", "strength", "readout")


def optimum_angle(state: State) -> float:
    """Return the angle in degrees of the optimum at the target angle 0."""
    best = state.ground.optimum.attainable.optimum(0.0).point
    return angle_of(best.env, best.social)


def adaptation_rows(state: State) -> list[Row]:
    """Return the first update of each run within 20 degrees of the optimum, and the settled one.

    The thesis writes |α̂ - α_target| < 20 with α_target = 0 and calls -42 degrees reached, so the
    optimum's own angle must be meant. Both are empty if there is none.
    """
    goal = optimum_angle(state)
    table = []
    for entry, steps in labelled(state.tables["checkpoints"], *KEYS, "seed"):
        near = [abs(angle_difference(row["angle"], goal)) < WITHIN for row in steps]
        entry |= {"first_update_within": steps[near.index(True)]["updates"] if any(near) else ""}
        entry |= {"settled_update": settled(column(steps, "updates"), near)}
        entry |= {"within_at_end": int(near[-1])}
        table.append(entry)
    return table


def summary(state: State) -> dict[str, Any]:
    """Return pooled metrics and number of adapted seeds by variant, action selection and λ."""
    variants: dict[str, dict] = {}
    for row in state.tables["pooled"]:
        runs = matching(state.tables["adaptation"], **{key: row[key] for key in KEYS})
        first, stays = (
            [value for value in column(runs, name) if value != ""]
            for name in ("first_update_within", "settled_update")
        )
        by_readout = variants.setdefault(row["target_kind"], {})
        by_readout.setdefault(row["readout"], {})[f"{row['strength']:g}"] = {
            key: value for key, value in row.items() if key not in KEYS
        } | {
            "adapted_at_end": sum(column(runs, "within_at_end")),
            "adapted_ever": len(first),
            "mean_first_update": float(np.mean(first)) if first else None,
            "mean_settled_update": float(np.mean(stays)) if stays else None,
        }
    seeds = len(state.config.seeds)
    return {"optimum_angle": optimum_angle(state), "seeds": seeds, "readings": variants}


def adaptation_figure(results: Results) -> dict[str, Figure]:
    """Draw Fig D.1 of the greedy policies with the first kind of target."""
    shown = {"target_kind": results.config["target_kinds"][0], "readout": "greedy"}
    rows = matching(results.tables["checkpoints"], **shown)
    title = "Small λ leaves the greedy policy as without a prior, large λ turns it at once"
    return {"fig_d_1": adaptation(rows, title, results.summary["optimum_angle"])}
