"""Drives dials, clones and the calibrated drivers in a recorded junction, on the same episodes.

    python examples/recordings/closed_loop.py WORLD --dials DIAL... --clones POLICY... --out FOLDER

Writes trade_off.csv, a row for each policy and angle, and trade_off.png. A dial has a row for each
of its training seeds; nothing is chosen.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.plotting.style import COLORS, figure, finish, png
from socialiq.results_folder import as_csv
from socialiq.types import Ending, Policy, Row
from socialiq_recordings.world.gym import JunctionBatch
from socialiq_recordings.world.recorded_world import AS_DRIVER, RecordedWorld

ANGLES = (0.0, 30.0, 60.0, 90.0)
OUTCOMES = {"arrival": 1, "collision": 2, "timeout": 3, "closed_line": 4}
INKS = ("#2166ac", "#67a9cf", "#1b7837")


def drive(world: RecordedWorld, policy: Policy | None, seeds: range) -> Row:
    """Drive an episode for each seed; without a policy as a driver of the population."""
    size = len(seeds)
    batch, live = JunctionBatch(world, size), np.ones(size, bool)
    seen, totals, ending = batch.reset(list(seeds)), np.zeros((size, 2)), np.zeros(size, int)
    while live.any():
        action = np.full(size, AS_DRIVER) if policy is None else policy.predict(seen)[0]
        made = batch.step(np.asarray(action, np.int64), auto_reset=False, rows=live)
        totals[live] += np.stack(made.rewards, axis=1)[live]
        ending[live] = made.ending[live]
        live &= made.ending == int(Ending.NONE)
        seen = made.observation
    shares = {name: float((ending == kind).mean()) for name, kind in OUTCOMES.items()}
    return {"r_env": float(totals[:, 0].mean()), "r_social": float(totals[:, 1].mean())} | shares


def main() -> None:
    """Drive, write the table and the picture, print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("world", type=Path)
    parser.add_argument("--dials", type=Path, nargs="+", default=[])
    parser.add_argument("--clones", type=Path, nargs="+", default=[])
    parser.add_argument("--episodes", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    world = RecordedWorld.load(given.world)
    seeds = range(given.seed, given.seed + given.episodes)
    rows: list[Row] = [{"policy": "drivers", "angle": ""} | drive(world, None, seeds)]
    for path in given.clones:
        rows.append({"policy": f"clone {path.stem}", "angle": ""})
        rows[-1] |= drive(world, QPolicy.load(path), seeds)
    for path in given.dials:
        dial = DialPolicy.load(path)
        for angle in ANGLES:
            found = drive(world, dial.at(angle), seeds)
            rows.append({"policy": path.stem, "angle": angle} | found)
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "trade_off.csv").write_text(as_csv(rows))
    (given.out / "trade_off.png").write_bytes(png({"trade_off": picture(rows)})["trade_off"])
    print(as_csv(rows))


def picture(rows: list[Row]):
    """Draw r_social over r_env: a line for each dial, points for the others."""
    drawn = figure(5.6, 4.2)
    axes = drawn.subplots()
    names = dict.fromkeys(row["policy"] for row in rows)
    dials = [name for name in names if name.startswith("dial")]
    for name in names:
        own = [row for row in rows if row["policy"] == name]
        x, y = [row["r_env"] for row in own], [row["r_social"] for row in own]
        if name in dials:
            ink = INKS[dials.index(name) % len(INKS)]
            axes.plot(x, y, marker="o", color=ink, label=name)
            for row in own:
                axes.annotate(f"{row['angle']:g}°", (row["r_env"], row["r_social"]), fontsize=7)
        else:
            mark = "s" if name == "drivers" else "^"
            axes.plot(x, y, mark, color=COLORS["baseline"], label=name)
    finish(axes, "", 8, xlabel="mean r_env of an episode", ylabel="mean r_social of an episode")
    return drawn


if __name__ == "__main__":
    main()
