"""`sweep`: train every combination of settings that a file names."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from socialiq import results_folder as store
from socialiq.cli.output import Display, Printing, complain, print_json, print_table
from socialiq.errors import UserError
from socialiq.results_folder import Results
from socialiq.storage import write_atomically
from socialiq.types import Row
from socialiq_lab.engine import Engine, run_jobs
from socialiq_lab.jobs import do, fingerprints, job_environment, open_jobs
from socialiq_lab.slurm import array_script
from socialiq_lab.sweep.plan import Plan, read_plan
from socialiq_lab.sweep.runs import results_of

OUTCOMES = ("readout", "angle", "r_env", "r_social", "arrival", "regret")


@dataclass(frozen=True)
class Sweep(Printing):
    """Train every combination of hyperparameters, seeds, data sets and worlds that a file names.

    Runs that share static settings train together in one compiled program. What is finished is
    kept in FOLDER.work, so the same command goes on where it was stopped, in whatever way.

    Example: socialiq sweep sweep.toml --out my-sweep
    """

    file: Annotated[Path, tyro.conf.Positional]
    """TOML: data, learner, worlds, seeds, preset, and the tables static and hyperparameters."""
    out: Path
    """Folder to write: runs.csv, config.json, summary.json and the policies."""
    work: Path | None = None
    """Folder of what is finished, by default FOLDER.work."""
    engine: tyro.conf.OmitArgPrefixes[Engine] = field(default_factory=Engine)
    slurm: bool = False
    """Write a Slurm array script into the work folder instead, a task for each open job."""
    task: int | None = None
    """Do the job of this number only, as a task of the Slurm script does."""
    allow_code: bool = False
    """Import modules of environments, or a learner: their authors' code runs with your rights."""
    replace: bool = False
    """Replace the results that are in the folder."""

    @property
    def output(self) -> Path | None:
        """The folder that the command writes; tasks write to a work folder that they share."""
        return self.out if self.task is None and not self.slurm else None

    def run(self) -> int:
        """Do the jobs, or one of them, or write the script that does them."""
        plan = read_plan(self.file, self.allow_code)
        work = (self.work or self.out.with_name(f"{self.out.name}.work")).absolute()
        if self.task is not None:
            return self.do_one(plan, work)
        if self.slurm:
            return self.write_script(plan, work)
        store.check_target(self.out, self.replace)
        with Display() as display:
            run_jobs(plan.jobs, work, display.stage, self.engine.processes, self.engine.cluster)
        results = results_of(plan.jobs, work, plan.settings)
        store.save(results, self.out, {}, self.replace)
        if self.json:
            print_json({"out": str(self.out)} | results.summary)
        else:
            print_table(summary_rows(results))
            print_failures(results)
        return 1 if results.summary["failures"] else 0

    def do_one(self, plan: Plan, work: Path) -> int:
        """Do one job in this process, unless it is finished."""
        assert self.task is not None
        if not 0 <= self.task < len(plan.jobs):
            raise UserError(f"task must be from 0 to {len(plan.jobs) - 1}, got {self.task}")
        job = plan.jobs[self.task]
        seconds = do(job, work, fingerprints(plan.jobs)[job.name], lambda _: None)
        sys.stdout.write(f"{job.name}: finished, {seconds:.1f} s\n")
        return 0

    def write_script(self, plan: Plan, work: Path) -> int:
        """Write the array script of the open jobs."""
        waiting = {job.name for job in open_jobs(plan.jobs, work)}
        numbers = [number for number, job in enumerate(plan.jobs) if job.name in waiting]
        if not numbers:
            raise UserError("every job is finished: give the command without --slurm")
        words = [sys.executable, "-m", "socialiq", "sweep", str(self.file.absolute())]
        words += ["--out", str(self.out.absolute()), "--work", str(work)]
        words += ["--allow-code"] if self.allow_code else []
        text = array_script([*words, "--task"], numbers, work, job_environment(work))
        try:
            work.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UserError(f"cannot make {work}: {error.strerror}; choose another") from error
        script = work / "sweep.sh"
        write_atomically(script, text)
        sys.stdout.write(
            f"sbatch {script}\n"
            "then, when its tasks have ended, this command without --slurm writes the results\n"
        )
        return 0


def summary_rows(results: Results) -> list[Row]:
    """Rows of the table that fit a screen: settings that differ, and what came out."""
    rows = results.tables["runs"]
    names = list(rows[0])
    selected = [name for name in names[: names.index("policy")] if name != "data"]
    selected += [name for name in ("loss", *OUTCOMES) if name in names]
    return [{name: row[name] for name in selected} for row in rows]


def print_failures(results: Results) -> None:
    """Print a line for every run that stopped early, on standard error."""
    for line in dict.fromkeys(row["failure"] for row in results.tables["runs"]):
        if line:
            complain(line)
