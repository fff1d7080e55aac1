"""`demo`, `reproduce` and `claims`: the studies, and what came of the thesis' claims."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, NamedTuple

import tyro
from matplotlib.figure import Figure

from socialiq.cli.output import print_json, print_table
from socialiq.cli.progress import Display
from socialiq.errors import UserError, one_of
from socialiq.figures import alternatives as alternatives_figures
from socialiq.figures import classic_control as classic_control_figures
from socialiq.figures import grid as grid_figures
from socialiq.figures import intersection_world as intersection_world_figures
from socialiq.figures import lambda_sweep as lambda_sweep_figures
from socialiq.figures import poc as poc_figures
from socialiq.figures import worlds as worlds_figures
from socialiq.figures.style import png
from socialiq.thesis import (
    alternatives,
    claims,
    classic_control,
    grid,
    intersection_world,
    lambda_sweep,
    poc,
    store,
    worlds,
)
from socialiq.thesis.experts import MODES
from socialiq.thesis.store import Results, Row
from socialiq.worlds.intersection.batch import BACK_ENDS


class Study(NamedTuple):
    """A study's module (with `Config` and `run`), its figures, and the table to print."""

    module: ModuleType
    draw: Callable[[Results], dict[str, Figure]]
    main_table: str


STUDIES = {
    "worlds": Study(worlds, worlds_figures.draw, "crossing7_readings"),
    "poc": Study(poc, poc_figures.draw, "agreement"),
    "grid": Study(grid, grid_figures.draw, "pooled"),
    "lambda-sweep": Study(lambda_sweep, lambda_sweep_figures.draw, "pooled"),
    "alternatives": Study(alternatives, alternatives_figures.draw, "pooled"),
    "intersection-world": Study(intersection_world, intersection_world_figures.draw, "outcomes"),
    "classic-control": Study(classic_control, classic_control_figures.draw, "returns"),
}


@dataclass(frozen=True)
class Reproduce:
    """Run a study: worlds and intersection-world (5.1), poc (6.1), grid (6.2), and the appendices.

    Example: socialiq reproduce grid --out my-results
    """

    study: Annotated[str, tyro.conf.Positional]
    """worlds, intersection-world, poc, grid, alternatives (appendix B), lambda-sweep (D); or
    classic-control, an outside check."""
    out: Path | None = None
    """Folder to write; by default ./results-STUDY."""
    seeds: tuple[int, ...] = ()
    """Training seeds; by default those of the committed results."""
    episodes: int | None = None
    """Episodes, in studies that count them."""
    back_end: str = ""
    """core or highway_env, in studies of the intersection."""
    replace: bool = False
    """Replace the results that are in the folder."""
    from_: Annotated[Path | None, tyro.conf.arg(name="from")] = None
    """Show the results of this folder without running anything."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Run or read, then print."""
        one_of("study", self.study, tuple(STUDIES))
        if self.from_ is not None:
            results = store.load(self.from_)
        else:
            folder = self.out or Path(f"results-{self.study}")
            store.check_target(folder, self.replace)
            results = self.compute()
            save(self.study, results, folder, self.replace)
        if self.json:
            print_json({"study": results.study, "config": results.config} | results.summary)
        else:
            show(results)
        return 0

    def compute(self) -> Results:
        """Run the study with its progress shown."""
        module = STUDIES[self.study].module
        config = module.Config(**self.given(module.Config))
        with Display() as display:
            return module.run(config, display.stage)

    def given(self, kind: Any) -> dict[str, Any]:
        """The options of the study that were given.

        Raises:
            UserError: If the study has no such option.
        """
        options = {"seeds": self.seeds, "episodes": self.episodes, "back_end": self.back_end}
        found = {name: value for name, value in options.items() if value not in ((), None, "")}
        names = {field.name for field in dataclasses.fields(kind)}
        for name in found:
            if name not in names:
                raise UserError(f"{self.study} has no --{name.replace('_', '-')}: leave it out")
        if "back_end" in found:
            one_of("back end", self.back_end, BACK_ENDS)
        if self.episodes is not None and self.episodes < 1:
            raise UserError(f"episodes must be at least 1, got {self.episodes}")
        return found


@dataclass(frozen=True)
class Demo:
    """Train the 7x7 baseline and three targets on five seeds, beside the thesis and the optimum.

    Example: socialiq demo
    """

    out: Path = Path("demo")
    """Folder for the tables and figures; an earlier demo there is replaced."""
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Training seeds."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Run the small grid study, print the table, say where to look next."""
        store.check_target(self.out, replace=True)
        config = grid.Config(
            seeds=self.seeds, target_kinds=("running",), strengths=(2.0,), comparisons=False
        )
        with Display() as display:
            results = grid.run(config, display.stage)
        save("grid", results, self.out, replace=True)
        rows = comparison(results)
        if self.json:
            print_json({"table": rows, "out": str(self.out)})
            return 0
        print_table(rows, f"7x7: angle in degrees, greedy, {len(self.seeds)} seeds, exact")
        print(
            f"\nThe pictures are in {self.out}/: tradeoff.png first, then fig_6_2_ring.png.\n"
            "The optimum for 45 degrees itself lies at 10.0 degrees: an angle of 39 would be a\n"
            "deviation, so read the regret column (0 is optimal), not the angle's distance.\n"
            "Next: socialiq claims (what of the thesis holds), docs/reproduction/grid.md (why),\n"
            "socialiq train --help (your own angle)."
        )
        return 0


@dataclass(frozen=True)
class Claims:
    """The ledger: each checkable claim of the thesis, our value, and the verdict.

    Example: socialiq claims --verdict not
    """

    results: Path | None = None
    """Folder that holds results/STUDY; by default the results that came with the package."""
    verdict: str = ""
    """Only these: reproduced, partly, not or untested."""
    study: str = ""
    """Only the claims that this study tests."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Resolve our values and print."""
        rows = claims.ledger(self.results or claims.packaged_results())
        if self.verdict:
            one_of("verdict", self.verdict, claims.VERDICTS)
            rows = [row for row in rows if row["verdict"] == self.verdict]
        if self.study:
            one_of("study", self.study, claims.STUDIES)
            rows = [row for row in rows if row["study"] == self.study]
        counts = claims.count(rows)
        if self.json:
            print_json({"counts": counts, "claims": rows})
            return 0
        for row in rows:
            print(described(row))
        print(", ".join(f"{number} {verdict}" for verdict, number in counts.items()))
        return 0


def described(row: Row) -> str:
    """A claim as a short paragraph."""
    lines = [f"[{row['verdict']}] {row['id']} ({row['place']})", row["statement"]]
    lines += [f"thesis: {row['thesis']}"]
    lines += [f"ours: {row['ours']}"] if row["ours"] else []
    lines += [f"because: {row['reason']}"] if row["reason"] else []
    lines += [f"command: {row['command']}"] if row["command"] else []
    wrapped = [lines[0], *(textwrap.fill(line, 96) for line in lines[1:])]
    return textwrap.indent("\n".join(wrapped), "  ")[2:] + "\n"


def save(study: str, results: Results, folder: Path, replace: bool) -> None:
    """Write a study's results with its figures."""
    store.save(results, folder, png(STUDIES[study].draw(results)), replace)


def show(results: Results) -> None:
    """A study's main table."""
    if results.study == "grid":
        print_table(comparison(results), "angle in degrees; greedy, means over seeds, exact")
    elif results.study == "worlds":
        print_table(results.tables["crossing5_readings"], "crossing5: experts by reading")
        angles = ("reading", "egoistic_angle", "prosocial_angle", "altruistic_angle")
        rows = [{key: row[key] for key in angles} for row in results.tables["crossing7_readings"]]
        print_table(rows, "crossing7: angle of the optimum by reading, degrees")
    elif results.study == "intersection-world":
        shown = ("population", "driver", *intersection_world.OUTCOMES, "ego_struck", "speed_kmh")
        rows = [{key: row[key] for key in shown} for row in results.tables["outcomes"]]
        print_table(rows, "shares of episodes; ego_struck: the ego ran into another")
    elif results.study == "lambda-sweep":
        kind = results.config["target_kinds"][0]
        rows = [
            {key: row[key] for key in ("strength", "readout", "angle", "arrival", "length")}
            for row in results.tables["pooled"]
            if row["target_kind"] in ("baseline", kind)
        ]
        print_table(rows, f"{kind} target, means over seeds, exact")
    else:
        print_table(results.tables[STUDIES[results.study].main_table])


def comparison(results: Results) -> list[Row]:
    """Target angle, ours, the thesis' and the optimum's, for the figures' policies."""
    rows: list[Row] = []
    targets: dict[str, Any] = {"baseline": None, **MODES}
    for name, angle in targets.items():
        entry = results.summary["policies"][f"{name}_greedy"]
        expert = results.summary["experts"].get(name, {})
        rows.append(
            {
                "policy": name,
                "target": "none" if angle is None else f"{angle:g}",
                "angle": entry["angle"],
                "thesis": grid_figures.THESIS_ANGLES[name],
                "optimum": expert.get("angle", ""),
                "regret": "" if angle is None else entry["regret"],
                "arrival": entry["arrival"],
                "timeout": entry["timeout"],
            }
        )
    return rows
