"""Drives dials, clones and the calibrated drivers in a recorded junction, on the same episodes.

    python examples/recordings/closed_loop.py WORLD --dials DIAL... --clones POLICY... --out FOLDER

Writes trade_off.csv, a row for each policy and angle, and trade_off.png. A dial has a row for each
of its training seeds; nothing is chosen.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.measures import DECISION
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.plotting.style import COLORS, figure, finish, png
from socialiq.results_folder import as_csv
from socialiq.types import Ending, Policy, Row
from socialiq_recordings.world.recorded_world import RecordedWorld

ANGLES = (0.0, 30.0, 60.0, 90.0)
INKS = ("#2166ac", "#67a9cf", "#1b7837")


def drive(world: RecordedWorld, policy: Policy, seeds: range) -> Row:
    """Drive an episode for each seed."""
    episodes = episodes_of(world.batch(len(seeds)), policy, seeds, quantities=DECISION)
    names = ("r_env", "r_social", "arrival", "collision", "timeout")
    row: Row = {name: float(episodes[name].mean()) for name in names}
    return row | {"closed_line": float((episodes.ending == Ending.OTHER).mean())}


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
    rows: list[Row] = [
        {"policy": "drivers", "angle": ""} | drive(world, world.driver("driver"), seeds)
    ]
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
