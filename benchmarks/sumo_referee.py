"""SUMO as the referee of caused delays: the same states and actions in our core and in SUMO.

    python benchmarks/sumo_referee.py --out results/sumo-referee

Each state is that of the intersection at a reset, without later arrivals, so both worlds have the
same vehicles at the same places and speeds, with the same desired speeds. A driver of the core
chooses the actions, and SUMO's ego takes the same ones; its last one is repeated. Needs the extra
`sumo`.
"""

from __future__ import annotations

import argparse
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.results_folder import as_csv
from socialiq.statistics.intervals import wilson
from socialiq.types import Ending
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.registry import make
from socialiq.worlds.sumo.simulation import Episode
from socialiq.worlds.sumo.traffic import EGO, Scene, SumoOptions

FIRST_SEED, STATES = 120_000_000, 200
DRIVERS = "go", "wait", "gap_3s", "random"
MODELS = "IDM", "Krauss", "IDM_heedless"
HEEDLESS = 55  # speed mode: for vehicles ahead alone, without right of way at junctions and in them
HORIZON, LEAST = 30.0, 2.0  # s to the common end; m from which a delay has a sign
ARMS = "SWNE"
LENGTH, LIMIT = 100.0, 10.0  # m of an approach, m/s of every lane

Row = dict[str, Any]


class Copied(Scene):
    """Traffic of one state of the core, in SUMO."""

    def __init__(self, batch: Any, following: Any) -> None:
        super().__init__(SumoOptions(following=following, warm_up=0.0, horizon=HORIZON))
        vehicles, episode = batch.buffers.vehicles[0], batch.buffers.episodes[0]
        self.lines = list[str]()
        for slot in range(episode["vehicles"]):
            vehicle = vehicles[slot]
            name = EGO if slot == episode["controlled"][0] else f"vehicle{vehicle['identity']}"
            ways = [ARMS[vehicle[end]] for end in ("origin", "destination")]
            front = LENGTH - stop_distance(vehicle) + 2.5
            if name == EGO:
                self.place = front
            kind = EGO if name == EGO else "vehicle"
            self.lines.append(
                f'<vehicle id="{name}" type="{kind}" depart="0" departLane="best" '
                f'departPos="{front:.3f}" departSpeed="{min(vehicle["speed"], LIMIT):.3f}" '
                f'speedFactor="{min(vehicle["target_speed"] / LIMIT, 1.0):.4f}" '
                f'insertionChecks="none"><route edges="{ways[0]}C C{ways[1]}"/></vehicle>'
            )

    def front(self, seed: int) -> float:  # noqa: ARG002  the state is fixed
        """Return where the ego's front is."""
        return self.place

    def demand(self, seed: int, with_ego: bool) -> str:  # noqa: ARG002
        """Return the vehicles of the state."""
        lines = [line for line in self.lines if with_ego or f'id="{EGO}"' not in line]
        return "\n".join(["<routes>", *self._types(), *lines, "</routes>"])


class Heedless(Episode):
    """Episode in which SUMO's drivers heed no right of way, neither at a junction nor within it."""

    def _begin(self, with_ego: bool) -> None:
        super()._begin(with_ego)
        for name in self.sumo.vehicle.getIDList():
            if name != EGO:
                self.sumo.vehicle.setSpeedMode(name, HEEDLESS)


def stop_distance(vehicle: Any) -> float:
    """Return the metres from a vehicle's middle to its stop line, 11 m from the junction's."""
    return max(abs(vehicle["x"]), abs(vehicle["y"])) - 11.0


def is_plain(batch: Any) -> bool:
    """Whether every vehicle is on an approach, with its front before the line."""
    vehicles = batch.buffers.vehicles[0][: batch.buffers.episodes["vehicles"][0]]
    return all(vehicle["lane"] % 5 == 0 and stop_distance(vehicle) > 2.5 for vehicle in vehicles)


def compare(seed: int, driver: str, model: str) -> Row:
    """Drive one state in both, and return the delays."""
    batch = make("intersection-caused", spawn_probability=0.0, horizon=HORIZON).batch(1)
    observation = batch.reset([seed])
    following, _, heedless = model.partition("_")
    lasting = (Heedless if heedless else Episode)(Copied(batch, following), seed)
    chooser = policy(driver, seed)
    delay, actions, ending = 0.0, list[int](), 0
    while not ending:
        action = np.asarray(chooser.predict(observation)[0]).reshape(1)
        decisions = batch.step(action, auto_reset=False)
        observation, ending = decisions.observation, int(decisions.ending[0])
        actions.append(int(action[0]))
        delay += float(decisions.signals["delay"][0])
    sumo, result = 0.0, None
    while result is None or result.ending == Ending.NONE:
        result = lasting.step(actions[min(len(lasting.actions), len(actions) - 1)])
        sumo += float(result.caused[:, 0].sum())
    return {
        "seed": seed,
        "driver": driver,
        "model": model,
        "others": len(lasting.without),
        "core": round(delay, 3),
        "sumo": round(sumo, 3),
        "core_ending": Ending(ending).name.lower(),
        "sumo_ending": result.ending.name.lower(),
    }


def agreement(rows: list[Row]) -> Row:
    """Return the share of equal signs where the delay in the core, or in both, exceeds 2 m.

    `same_ending` is of those where the core's exceeds 2 m and the ego ends alike in both.
    """
    core, sumo = (np.array([row[side] for row in rows]) for side in ("core", "sumo"))
    summary: Row = {"compared": len(rows)}
    large, alike = np.abs(core) > LEAST, [row["core_ending"] == row["sumo_ending"] for row in rows]
    subsets = {"core": large, "same_ending": large & alike, "both": large & (np.abs(sumo) > LEAST)}
    for name, where in subsets.items():
        equal = int((np.sign(core[where]) == np.sign(sumo[where])).sum())
        share = wilson(equal, int(where.sum())) if where.any() else (np.nan,) * 3
        summary |= {f"{name}_above_2_m": int(where.sum()), f"{name}_agree": share[0]}
        summary |= {f"{name}_low": share[1], f"{name}_high": share[2]}
    summary |= {"mean_core": float(core.mean()), "mean_sumo": float(sumo.mean())}
    summary["correlation"] = float(np.corrcoef(core, sumo)[0, 1])
    return summary | {"ends_alike": float(np.mean(alike))}


def main() -> None:
    """Compare and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--states", type=int, default=STATES)
    chosen = parser.parse_args()
    seeds, seed = list[int](), FIRST_SEED
    batch = make("intersection", spawn_probability=0.0).batch(1)
    while len(seeds) < chosen.states:
        batch.reset([seed])
        if is_plain(batch):
            seeds.append(seed)
        seed += 1
    rows = [compare(s, driver, model) for model in MODELS for driver in DRIVERS for s in seeds]
    tables = list[Row]()
    for model in MODELS:
        mine = [row for row in rows if row["model"] == model]
        for driver in ("all", *DRIVERS):
            part = [row for row in mine if driver in ("all", row["driver"])]
            tables.append({"model": model, "driver": driver} | agreement(part))
    chosen.out.mkdir(parents=True, exist_ok=True)
    (chosen.out / "states.csv").write_text(as_csv(rows))
    (chosen.out / "agreement.csv").write_text(as_csv(tables))
    config = {
        "first_seed": FIRST_SEED, "states": chosen.states, "last_seed": seed - 1,
        "drivers": DRIVERS, "horizon": HORIZON, "least": LEAST, "libsumo": version("libsumo"),
    }  # fmt: skip
    (chosen.out / "config.json").write_text(json.dumps(config, indent=1) + "\n")
    for row in tables:
        print({name: round(v, 3) if isinstance(v, float) else v for name, v in row.items()})


if __name__ == "__main__":
    main()
