"""MO-Gymnasium's two-objective tasks: one dial beside methods of morl-baselines.

An outside check, no claim of the thesis. Every method takes the same number of steps in a task's
environment. Each (task, method, seed) is a piece of its own: what is finished is kept, and peers'
pieces come from `benchmarks/peers/mo_gymnasium_peer.py`, which runs morl-baselines as it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from socialiq import UserError
from socialiq.evaluation.front import expected_utility, hypervolume, utilities, utility_losses
from socialiq.results_folder import Results
from socialiq.social.angle import exact_weights
from socialiq.statistics.comparisons import holm, mean_contrast, permutation_p
from socialiq.storage import packaged_results
from socialiq.types import Row
from socialiq_lab.comparison import as_file_name, check_names
from socialiq_lab.jobs import Job
from socialiq_lab.study import Context, Findings, View
from socialiq_lab.tables import column, groups, nested, spread, with_holm
from studies.mo_gymnasium import tasks, training
from studies.mo_gymnasium.tasks import ANGLES, FOLDER, TASKS, Piece
from studies.mo_gymnasium.training import DIAL, METHODS, STANDARDISED


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    tasks: tuple[str, ...] = tuple(TASKS)  # names of `TASKS`
    methods: tuple[str, ...] = METHODS
    """Names of `METHODS`, ours. Peers are read from `pieces`."""
    seeds: tuple[int, ...] = (200, 201, 202, 203, 204)
    """Training seeds of ours. 100 to 199 were used in development; the peers' are 300 to 304."""
    steps: int = 0  # steps of a method in the environment; 0 for those of each task
    pieces: str = ""
    """Folder of finished pieces, which are not made again; by default the committed ones."""
    again: bool = False  # whether ours are trained again although they are there
    train: bool = True
    """Whether what is missing of ours is trained; else the tables are of what is there."""

    def __post_init__(self) -> None:
        """Refuse unknown names and empty sizes."""
        check_names(self, tasks=TASKS, methods=METHODS)
        if not self.tasks or not self.seeds:
            raise UserError("name at least one task and one training seed")
        if self.steps < 0:
            raise UserError(f"steps must be at least 1, or 0 for the task's, got {self.steps}")
        if self.pieces and not Path(self.pieces).is_dir():
            raise UserError(f"{self.pieces} is no folder: name the folder of finished pieces")

    def methods_of(self, task: str) -> tuple[str, ...]:
        """Return the methods of ours that a task has."""
        standardises = TASKS[task].continuous
        return tuple(method for method in self.methods if standardises or method != STANDARDISED)

    def budget(self, task: str) -> int:
        """Return the steps that a method may take in a task."""
        return self.steps or TASKS[task].steps

    def saved_pieces(self) -> list[Piece]:
        """Return the finished pieces of the tasks, with their steps; peers' of every seed."""
        folder = Path(self.pieces or packaged_results() / "mo-gymnasium" / FOLDER)
        pieces = tasks.within(tasks.read(folder), {task: self.budget(task) for task in self.tasks})
        ours = () if self.again else self.methods
        return [
            piece
            for piece in pieces
            if piece.method not in METHODS or (piece.method in ours and piece.seed in self.seeds)
        ]


LINEAR, FRONT = "exact, linear", "known front"
"""Rows of reference: the optimum of each angle, and all totals that no other dominates."""

COMPARED = ("hypervolume", "expected_utility")
MEASURES = (*COMPARED, "asked_utility", "mean_loss", "largest_loss", "asked_loss")


def jobs(config: Config) -> list[Job]:
    """Return a job for each task and method of ours whose pieces are not all there."""
    if not config.train:
        return []
    there = {(piece.task, piece.method, piece.seed) for piece in config.saved_pieces()}
    planned = []
    for task in config.tasks:
        for method in config.methods_of(task):
            seeds = tuple(seed for seed in config.seeds if (task, method, seed) not in there)
            if seeds:
                run = training.Training(task, method, seeds, config.budget(task))
                name = f"{task}/{as_file_name(method)}"
                planned.append(Job(name, training.train_and_evaluate, run, cost=float(len(seeds))))
    return planned


def compute_tables(config: Config, context: Context) -> Findings:
    """Measure every piece, and add the references of tasks whose front is known."""
    pieces = config.saved_pieces()
    for job in context.jobs:
        pieces += tasks.read(context.work / job.name / FOLDER)
    order = {method: number for number, method in enumerate(METHODS)}  # ours stand first
    ours = len(METHODS)
    pieces.sort(key=lambda p: (p.task, order.get(p.method, ours), p.method, p.seed))
    rows = [measured(piece) for piece in pieces]
    exact = [task for task in config.tasks if TASKS[task].exact]
    coverage: list[Row] = []  # runs that are there, of how many that belong to the study
    for task in config.tasks:
        for method in (*config.methods_of(task), *TASKS[task].peers):
            there = sum((piece.task, piece.method) == (task, method) for piece in pieces)
            row = {"task": task, "method": method, "runs": there, "of": len(config.seeds)}
            coverage.append(row)
    references: list[Row] = []
    for task in exact:
        best = tasks.exact_set(task)
        linear = np.array([best.optimum(angle).point for angle in ANGLES])
        for method, totals in ((LINEAR, linear), (FRONT, tasks.known_front(task))):
            label = {"task": task, "method": method, "runs": 0, "steps": 0}
            references.append(_row(label, _measures(task, totals)))
    points: list[Row] = []
    for piece in pieces:
        label = {"task": piece.task, "method": piece.method, "seed": piece.seed}
        angles = piece.angles or [""] * len(piece.totals)
        for angle, (first, second) in zip(angles, piece.totals, strict=True):
            points.append(label | {"angle": angle, "first": first, "second": second})
    tables = {
        "pooled": sorted([*references, *pooled(rows)], key=lambda row: row["task"]),
        "comparisons": comparison_rows(rows),
        "coverage": coverage,
        "runs": rows,
        "points": points,
        "fronts": [
            {"task": task, "first": first, "second": second}
            for task in exact
            for first, second in tasks.known_front(task).tolist()
        ],
    }
    summary = nested(tables["pooled"], "task", "method", keep=MEASURES)
    files = {f"{FOLDER}/{piece.file}": piece.content() for piece in pieces}
    return Findings(tables, summary, files)


def measured(piece: Piece) -> Row:
    """Return the measures of one piece; losses only where the front is known.

    `asked_utility` and `asked_loss` are those of the policy of the asked angle alone;
    `second_rises` is the second reward at 90 degrees less that at 0.
    """
    row: Row = {name: getattr(piece, name) for name in ("task", "method", "seed", "steps")}
    row |= dict.fromkeys((*MEASURES, "second_rises"), "") | _measures(piece.task, piece.points)
    if piece.angles is not None:
        directions = np.array([exact_weights(angle) for angle in piece.angles])
        utility = (piece.points * directions).sum(axis=1)
        row["asked_utility"] = float(utility.mean())
        row["second_rises"] = float(piece.points[-1, 1] - piece.points[0, 1])
        if TASKS[piece.task].exact:
            best = utilities(tasks.exact_set(piece.task).vertices, ANGLES)
            row["asked_loss"] = float((best - utility).mean())
    return row


def _measures(name: str, points: np.ndarray) -> Row:
    """Return the measures of a set of mean totals on a task."""
    task = TASKS[name]
    area = hypervolume(points, np.array(task.reference))
    measures = {"hypervolume": area, "expected_utility": expected_utility(points, ANGLES)}
    if task.exact:
        losses = utility_losses(points, tasks.exact_set(name).vertices, ANGLES)
        measures |= {"mean_loss": float(losses.mean()), "largest_loss": float(losses.max())}
    return measures


def pooled(rows: Sequence[Row]) -> list[Row]:
    """Return the mean, least and largest of each measure over seeds, by task and method."""
    means = []
    for (task, method), group in groups(rows, "task", "method").items():
        steps = max(row["steps"] for row in group)
        label = {"task": task, "method": method, "runs": len(group), "steps": steps}
        measures: Row = {}
        for name in MEASURES:
            if all(row[name] != "" for row in group):
                ends = spread(group, name)
                measures[name] = ends["mean"]
                if name in COMPARED:
                    measures |= {f"{name}_least": ends["low"], f"{name}_largest": ends["high"]}
        means.append(_row(label, measures))
    return means


def comparison_rows(rows: Sequence[Row]) -> list[Row]:
    """Test the dials against every peer: Welch and permutation, Holm over a task and over all."""
    compared: list[Row] = []
    for (task,), group in groups(rows, "task").items():
        by_method = {method: runs for (method,), runs in groups(group, "method").items()}
        peers, tests = [entry for entry in by_method if entry not in METHODS], list[Row]()
        pairs = [(DIAL, peer) for peer in peers]
        for first, second in pairs + [(STANDARDISED, rival) for rival in (*peers, DIAL)]:
            first_runs, second_runs = by_method.get(first, []), by_method.get(second, [])
            if min(len(first_runs), len(second_runs)) < 2:
                continue
            for name in COMPARED:
                sides = np.array(column(first_runs, name)), np.array(column(second_runs, name))
                label = {"task": task, "first": first, "second": second, "measure": name}
                contrast = mean_contrast(*sides)._asdict()
                tests.append(label | contrast | {"p": permutation_p(*sides)})
        adjusted = holm([row["p"] for row in tests]).tolist()
        compared += [row | {"p_holm_task": p} for row, p in zip(tests, adjusted, strict=True)]
    return with_holm(compared)


def _row(label: Row, measures: Row) -> Row:
    """Return a row with every column, empty where a measure isn't defined."""
    names = [name + end for name in COMPARED for end in ("", "_least", "_largest")]
    label = {name: label[name] for name in ("task", "method", "runs", "steps")}
    return label | {name: measures.get(name, "") for name in (*names, *MEASURES[2:])}


def missing(results: Results) -> Sequence[View]:
    """Return the methods whose runs are not all there."""
    partial = [row for row in results.tables["coverage"] if row["runs"] < row["of"]]
    return [View(partial, "Not all there yet")] if partial else []
