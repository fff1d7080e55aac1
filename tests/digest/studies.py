"""Tiny runs of every study: every table, the summary and the other files' names."""

from __future__ import annotations

import functools
import unittest.mock
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file
from tests.digest.digest import Hashes, Item, differences, of_arrays, of_plain

from socialiq.learners.callbacks import Report
from socialiq.worlds.highway.options import SIGNALS
from socialiq_lab.jobs import Job, do, fingerprints, open_jobs
from socialiq_lab.registry import STUDIES, declaration

VOLATILE = ("seconds", "longest", "updates_per_second", "device", "rate")
"""Columns of times, which differ from run to run."""
VOLATILE_TABLES = ("times", "speed", "speeds")
OF_THE_PROCESSOR = {"audits": ("audits", "summary")}
"""Tables of audits of policies that are trained here: the file's hash decides the episodes, and the
last bits of its weights depend on the processor."""

NEEDS = {
    "influence-zone": ("sklearn",),
    "mujoco-imitation": ("mujoco",),
}
QUICK = ("audit-power", "off-policy")


def run_here(
    jobs: Sequence[Job],
    work: Path,
    on_stage: Callable[[str], Callable[[Report], None] | None],
    *_engine: object,
) -> None:
    """Run the open jobs one by one in this process: new ones take most of a tiny study's time."""
    known = fingerprints(jobs)
    for job in open_jobs(jobs, work):
        on_stage(job.stage)
        do(job, work, known[job.name], lambda _: None)


def tables_of(name: str, folder: Path) -> Hashes:
    """Run the tiny preset of a study; hash tables, summary and names of its other files."""
    from socialiq.settings import changed
    from socialiq_lab import study as studies
    from socialiq_lab.engine import Engine
    from socialiq_lab.registry import study_and_declaration

    study, content = study_and_declaration(name)
    config = changed(study.Config(), content["tiny"])
    with unittest.mock.patch.object(studies, "run_jobs", run_here):
        results = studies.run(study, config, work=folder / "work", engine=Engine(1))
    return hashes_of(results, folder / "work")


def hashes_of(results: Any, work: Path) -> Hashes:
    """Hash tables, summary and names of other files of a study, and the networks of its jobs."""
    hashes = {
        table: of_plain([without_times(row) for row in rows])
        for table, rows in results.tables.items()
        if table not in VOLATILE_TABLES
    }
    hashes["summary"] = of_plain(without_times(results.summary))
    for table in OF_THE_PROCESSOR.get(results.study, ()):
        del hashes[table]
    if results.files:
        hashes["files"] = of_plain(sorted(results.files))
    networks = sorted(work.rglob("*.safetensors"))
    if networks:
        hashes["networks"] = of_plain(sorted(of_arrays(arrays_in(path)) for path in networks))
    return hashes


def arrays_in(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a file; columns of episodes by their names in version 1 of the file."""
    arrays = load_file(path)
    if "classical_own" not in arrays:
        return arrays
    names = {"r_env": "totals_env", "r_social": "totals_social"}
    names |= {"classical_own": "classical_env", "classical_others": "classical_social"}
    for stacked, prefix in (("signals", "signal"), ("active", "active")):
        columns = [arrays.pop(f"{prefix}_{name}") for name in SIGNALS]
        arrays[stacked] = np.stack(columns, axis=1)
    return {names.get(name, name): column for name, column in arrays.items()}


def differs(name: str, results: Any, work: Path) -> list[str]:
    """Return a line for each hash of a study's tiny run that is not that of `digest.json`."""
    item = next(item for item in ITEMS if item.name == f"study/{name}")
    hashes = {f"{item.name}/{table}": value for table, value in hashes_of(results, work).items()}
    return list(differences([item], hashes, [], []))


def without_times(value: Any) -> Any:
    """Return rows or a summary without what is measured in seconds."""
    if isinstance(value, dict):
        kept = {name: one for name, one in value.items() if name not in VOLATILE}
        return {name: without_times(one) for name, one in kept.items()}
    if isinstance(value, list | tuple):
        return [without_times(one) for one in value]
    return value


ITEMS = [
    Item(
        f"study/{name}",
        functools.partial(tables_of, name),
        NEEDS.get(name, ()),
        name in QUICK,
    )
    for name in STUDIES
    if "tiny" in declaration(name)
]

COMPARED_BESIDE_THEIR_TESTS = {
    f"study/{name}"
    for name in (
        "alternatives",
        "audit-power",
        "audit-tests",
        "audits",
        "compare-methods",
        "dial",
        "expert-strength",
        "grid",
        "intersection",
        "intersection-continuous",
        "intersection-dial",
        "intersection-offline",
        "lambda-sweep",
        "off-policy",
        "own-data",
        "penalties",
        "poc",
        "theory",
        "worlds",
    )
}
"""Studies whose tests in tests/unit/studies run the tiny preset; `differs` is called there."""
