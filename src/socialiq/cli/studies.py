"""`reproduce`: the studies, run or shown."""

from __future__ import annotations

import dataclasses
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
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments import results as store
from socialiq.experiments.intersection.rows import OUTCOMES
from socialiq.experiments.results import Results
from socialiq.learners.ranges import check_seeds
from socialiq.plotting.style import png
from socialiq.storage import shipped
from socialiq.studies.alternatives import figures as alternatives_figures
from socialiq.studies.alternatives import study as alternatives
from socialiq.studies.audit_power import figures as audit_power_figures
from socialiq.studies.audit_power import study as audit_power
from socialiq.studies.audits import figures as audits_figures
from socialiq.studies.audits import study as audits
from socialiq.studies.classic_control import figures as classic_control_figures
from socialiq.studies.classic_control import study as classic_control
from socialiq.studies.competence import figures as competence_figures
from socialiq.studies.competence import study as competence
from socialiq.studies.dial import figures as dial_figures
from socialiq.studies.dial import study as dial
from socialiq.studies.grid import figures as grid_figures
from socialiq.studies.grid import study as grid
from socialiq.studies.intersection import figures as intersection_figures
from socialiq.studies.intersection import study as intersection
from socialiq.studies.intersection_ahead import figures as intersection_ahead_figures
from socialiq.studies.intersection_ahead import study as intersection_ahead
from socialiq.studies.intersection_dial import figures as intersection_dial_figures
from socialiq.studies.intersection_dial import study as intersection_dial
from socialiq.studies.intersection_networks import figures as intersection_networks_figures
from socialiq.studies.intersection_networks import study as intersection_networks
from socialiq.studies.intersection_skill import figures as intersection_skill_figures
from socialiq.studies.intersection_skill import study as intersection_skill
from socialiq.studies.intersection_world import figures as intersection_world_figures
from socialiq.studies.intersection_world import study as intersection_world
from socialiq.studies.lambda_sweep import figures as lambda_sweep_figures
from socialiq.studies.lambda_sweep import study as lambda_sweep
from socialiq.studies.poc import figures as poc_figures
from socialiq.studies.poc import study as poc
from socialiq.studies.theory import figures as theory_figures
from socialiq.studies.theory import study as theory
from socialiq.studies.worlds import figures as worlds_figures
from socialiq.studies.worlds import study as worlds
from socialiq.types import Row
from socialiq.worlds.intersection.batch import BACK_ENDS


class Study(NamedTuple):
    """A study's module (with `Config` and `run`), its figures, and the table to print.

    A resumable one takes a work folder too, and goes on from what is in it.
    """

    module: ModuleType
    draw: Callable[[Results], dict[str, Figure]]
    main_table: str
    resumable: bool = False


STUDIES = {
    "worlds": Study(worlds, worlds_figures.draw, "crossing7_readings"),
    "poc": Study(poc, poc_figures.draw, "agreement"),
    "grid": Study(grid, grid_figures.draw, "pooled"),
    "lambda-sweep": Study(lambda_sweep, lambda_sweep_figures.draw, "pooled"),
    "alternatives": Study(alternatives, alternatives_figures.draw, "pooled"),
    "dial": Study(dial, dial_figures.draw, "pooled"),
    "competence": Study(competence, competence_figures.draw, "pooled"),
    "intersection-world": Study(intersection_world, intersection_world_figures.draw, "outcomes"),
    "intersection": Study(intersection, intersection_figures.draw, "table_6_2", True),
    "intersection-networks": Study(
        intersection_networks, intersection_networks_figures.draw, "policies", True
    ),
    "intersection-ahead": Study(
        intersection_ahead, intersection_ahead_figures.draw, "policies", True
    ),
    "intersection-dial": Study(intersection_dial, intersection_dial_figures.draw, "families", True),
    "intersection-skill": Study(
        intersection_skill, intersection_skill_figures.draw, "pooled", True
    ),
    "audit-power": Study(audit_power, audit_power_figures.draw, "verdicts"),
    "audits": Study(audits, audits_figures.draw, "audits"),
    "theory": Study(theory, theory_figures.draw, "predicted"),
    "classic-control": Study(classic_control, classic_control_figures.draw, "returns"),
}


@dataclass(frozen=True)
class Reproduce:
    """Run a study of the thesis: worlds (5.1) to intersection (6.3, A), or an appendix.

    Those of the intersection take hours. They keep what is done in FOLDER.work, so the same
    command goes on where it was stopped, in whatever way.

    Example: socialiq reproduce grid --out my-results
    """

    study: Annotated[str, tyro.conf.Positional]
    """worlds, intersection-world, poc, grid, intersection, alternatives (appendix B), lambda-sweep
    (D); theory, its predictions held against training; dial, competence, intersection-dial,
    intersection-skill, intersection-networks and intersection-ahead, which go beyond it; audits of
    its tables and of our policies, audit-power, what an audit is worth; or classic-control, an
    outside check."""
    out: Path | None = None
    """Folder to write; by default ./results-STUDY."""
    seeds: tuple[int, ...] = ()
    """Training seeds; by default those of the committed results."""
    episodes: int | None = None
    """Episodes, in studies that count them."""
    back_end: str = ""
    """core or highway_env, in the study intersection-world."""
    parts: tuple[str, ...] = ()
    """Parts of the intersection study, by default all: main, strengths, targets, data, timeouts,
    views."""
    highway_episodes: int | None = None
    """Episodes of each final policy of the intersection's studies on the real highway-env."""
    work: Path | None = None
    """Folder of what is done, by default FOLDER.work."""
    replace: bool = False
    """Replace the results that are in the folder."""
    from_: Annotated[Path | None, tyro.conf.arg(name="from")] = None
    """Show the results of this folder, or of the study's in it, without running anything."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Run or read, then print."""
        one_of("study", self.study, tuple(STUDIES))
        if self.from_ is not None:
            results = self.kept(self.from_)
        else:
            folder = self.out or Path(f"results-{self.study}")
            store.check_target(folder, self.replace)
            results = self.compute(folder)
            save(self.study, results, folder, self.replace)
        if self.json:
            print_json({"study": results.study, "config": results.config} | results.summary)
        else:
            show(results)
        return 0

    def kept(self, folder: Path) -> Results:
        """The study's results in a folder, or in the folder of its name there.

        Raises:
            UserError: If there are none, or those of another study.
        """
        inside = shipped(folder / self.study)
        results = store.load(inside if inside.is_dir() else folder)
        if results.study != self.study:
            raise UserError(f"{folder} holds {results.study}: name that study, or another folder")
        return results

    def compute(self, folder: Path) -> Results:
        """Run the study with its progress shown."""
        study = STUDIES[self.study]
        module, config = study.module, study.module.Config(**self.given(study.module.Config))
        with Display() as display:
            if study.resumable:
                work = self.work or folder.with_name(f"{folder.name}.work")
                return module.run(config, display.stage, work)
            if self.work is not None:
                raise UserError(f"{self.study} keeps no work folder: leave out --work")
            return module.run(config, display.stage)

    def given(self, kind: Any) -> dict[str, Any]:
        """The options of the study that were given.

        Raises:
            UserError: If the study has no such option.
        """
        options = {
            name: getattr(self, name)
            for name in ("seeds", "episodes", "back_end", "parts", "highway_episodes")
        }
        found = {name: value for name, value in options.items() if value not in ((), None, "")}
        names = {field.name for field in dataclasses.fields(kind)}
        for name in found:
            if name not in names:
                raise UserError(f"{self.study} has no --{name.replace('_', '-')}: leave it out")
        check_seeds(self.seeds)
        if "back_end" in found:
            one_of("back end", self.back_end, BACK_ENDS)
        if self.episodes is not None and self.episodes < 1:
            raise UserError(f"episodes must be at least 1, got {self.episodes}")
        return found


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
        shown = ("population", "driver", *OUTCOMES, "ego_struck", "speed_kmh")
        rows = [{key: row[key] for key in shown} for row in results.tables["outcomes"]]
        print_table(rows, "shares of episodes; ego_struck: the ego ran into another")
    elif results.study == "intersection":
        for rows, title in intersection_tables(results):
            print_table(rows, title)
    elif results.study in ("intersection-networks", "intersection-ahead"):
        shown = ("policy", *intersection_networks.SHARES)
        rows = [{key: row[key] for key in shown} for row in results.tables["policies"]]
        print_table(rows, "shares of episodes; foresight: with one look at the true future")
    elif results.study == "intersection-dial":
        shown = ("family", "seed", "hypervolume", "mean_regret", "worst_regret")
        shown += ("rise_r_env", "drop_r_social", "most_arrivals")
        rows = [{key: row[key] for key in shown} for row in results.tables["families"]]
        print_table(rows, "regret against the best policy of all, over the key angles")
    elif results.study == "audits":
        shown = ("world", "policy", "declared", "truthful", "verdict", "decided_by", "regret")
        rows = [{key: row[key] for key in shown} for row in results.tables["audits"]]
        print_table(rows, "regret at the declared angle, in reward per episode")
    elif results.study == "dial":
        shown = ("run", "readout", "key_regret_mean", "key_regret_high", "ceiling_mean")
        shown += ("rise_r_env_high", "drop_r_social_high", "least_share_of_support_low")
        rows = [{key: row[key] for key in shown} for row in results.tables["pooled"]]
        print_table(rows, "over seeds; key regret: mean regret at 0, 15, ..., 90 degrees, exact")
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


def intersection_tables(results: Results) -> list[tuple[list[Row], str]]:
    """Table 6.2 of the experts and of each group of learners, greedy, a policy in each row."""
    rows = [row for row in results.tables["table_6_2"] if row["readout"] == "greedy"]
    found = []
    for preset, setting in dict.fromkeys((row["preset"], row["setting"]) for row in rows):
        table: dict[str, Row] = {}
        for row in rows:
            if (row["preset"], row["setting"]) == (preset, setting):
                shown = table.setdefault(row["policy"], {"policy": row["policy"]})
                shown[row["metric"]] = f"{row['ours']:.1f} ({row['thesis']:g})"
        found.append((list(table.values()), f"{preset}, {setting}: ours (thesis); %, km/h"))
    return found


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
