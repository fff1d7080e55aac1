"""`compare`: many methods in one table, run or shown."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import print_json, print_table
from socialiq.cli.progress import Display
from socialiq.errors import UserError, one_of
from socialiq.experiments import results as store
from socialiq.experiments.results import Results
from socialiq.learners.ranges import check_seeds
from socialiq.plotting.style import png
from socialiq.studies.compare_priors import figures, study
from socialiq.studies.compare_priors.config import Config
from socialiq.studies.compare_priors.methods import LABELS
from socialiq.types import Row

COMPARISONS = ("priors",)


@dataclass(frozen=True)
class Compare:
    """Compare methods at one budget: every place where the prior can enter, and the baselines.

    λ is chosen on seeds of development, the table is of other seeds. What is done is kept in
    FOLDER.work, so the same command goes on where it was stopped, in whatever way.

    Example: socialiq compare priors --worlds crossing7 --out my-comparison
    """

    comparison: Annotated[str, tyro.conf.Positional]
    """priors."""
    worlds: tuple[str, ...] = ()
    """crossing5, crossing7, intersection; by default the two gridworlds."""
    methods: tuple[str, ...] = ()
    """Rows of the table, by default all."""
    seeds: tuple[int, ...] = ()
    """Training seeds; by default those of the committed results."""
    out: Path = Path("results-compare-priors")
    """Folder to write."""
    work: Path | None = None
    """Folder of what is done, by default FOLDER.work."""
    replace: bool = False
    """Replace the results that are in the folder."""
    from_: Annotated[Path | None, tyro.conf.arg(name="from")] = None
    """Show the results of this folder without running anything."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Run or read, then print."""
        one_of("comparison", self.comparison, COMPARISONS)
        if self.from_ is not None:
            results = store.load(self.from_)
            if results.study != study.STUDY:
                raise UserError(f"{self.from_} holds {results.study}: name a comparison of priors")
        else:
            results = self.compute()
        if self.json:
            print_json({"study": results.study, "config": results.config} | results.summary)
        else:
            show(results)
        return 0

    def compute(self) -> Results:
        """Run what is not done yet, with its progress shown, and write the folder."""
        options = {name: getattr(self, name) for name in ("worlds", "methods", "seeds")}
        check_seeds(self.seeds)
        config = Config(**{name: value for name, value in options.items() if value})
        store.check_target(self.out, self.replace)
        work = self.work or self.out.with_name(f"{self.out.name}.work")
        with Display() as display:
            results = study.run(config, display.stage, work)
        store.save(results, self.out, png(figures.draw(results)), self.replace)
        return results


def show(results: Results) -> None:
    """For each world and readout a table of methods by target angle."""
    for world in dict.fromkeys(row["world"] for row in results.tables["pooled"]):
        for readout in ("greedy", "soft"):
            rows = table(results, world, readout)
            if rows:
                quantity = figures.quantity(results, world)
                title = f"{world}, {readout}: {quantity} at the target angle, mean over seeds"
                print_table(rows, title)


def table(results: Results, world: str, readout: str) -> list[Row]:
    """Rows are methods with their λ, columns target angles in degrees."""
    found: dict[str, Row] = {}
    quantity = figures.quantity(results, world)
    for row in results.tables["pooled"]:
        if (row["world"], row["readout"]) == (world, readout):
            strength: Any = figures.strength(row)
            label = {"method": LABELS[row["method"]], "λ": strength}
            shown = found.setdefault(row["method"], label)
            shown[f"{row['target_angle']:g}°"] = row[quantity]
    return list(found.values())
