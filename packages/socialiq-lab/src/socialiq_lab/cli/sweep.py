"""`sweep`: train every combination of settings that a file names."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from socialiq import UserError
from socialiq import results_folder as store
from socialiq.cli.output import Display, Printing, complain, print_json, print_table
from socialiq.storage import write_atomically
from socialiq_lab.engine import Engine, run_jobs
from socialiq_lab.jobs import check_work, do, fingerprints, job_environment, open_jobs
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
        check_work(work)
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
        else:  # what fits a screen: the settings that differ, and what came out
            rows = results.tables["runs"]
            names = list(rows[0])
            columns = [name for name in names[: names.index("policy")] if name != "data"]
            columns += [name for name in ("loss", *OUTCOMES) if name in names]
            print_table([{name: row[name] for name in columns} for row in rows])
            for line in dict.fromkeys(row["failure"] for row in rows if row["failure"]):
                complain(line)
        return 1 if results.summary["failures"] else 0

    def do_one(self, plan: Plan, work: Path) -> int:
        """Do the job number `task` in this process, unless it is finished.

        Args:
            plan: The sweep.
            work: Folder of finished jobs.

        Returns:
            Exit status 0.

        Raises:
            UserError: If no job has that number, or the work folder can't be written.
        """
        assert self.task is not None
        if not 0 <= self.task < len(plan.jobs):
            raise UserError(f"task must be from 0 to {len(plan.jobs) - 1}, got {self.task}")
        job = plan.jobs[self.task]
        seconds = do(job, work, fingerprints(plan.jobs)[job.name], lambda _: None)
        sys.stdout.write(f"{job.name}: finished, {seconds:.1f} s\n")
        return 0

    def write_script(self, plan: Plan, work: Path) -> int:
        """Write `sweep.sh`, the array script of the open jobs, into the work folder.

        Args:
            plan: The sweep.
            work: Folder of finished jobs; it is made if it does not exist.

        Returns:
            Exit status 0.

        Raises:
            UserError: If every job is finished, or the folder can't be made.
        """
        waiting = {job.name for job in open_jobs(plan.jobs, work)}
        numbers = [number for number, job in enumerate(plan.jobs) if job.name in waiting]
        if not numbers:
            raise UserError("every job is finished: give the command without --slurm")
        words = [sys.executable, "-m", "socialiq", "sweep", str(self.file.absolute())]
        words += ["--out", str(self.out.absolute()), "--work", str(work)]
        words += ["--allow-code"] if self.allow_code else []
        try:
            work.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UserError(f"cannot make {work}: {error.strerror}; choose another") from error
        script = work / "sweep.sh"
        write_atomically(
            script, array_script([*words, "--task"], numbers, work, job_environment(work))
        )
        sys.stdout.write(
            f"sbatch {script}\n"
            "then, when its tasks have ended, this command without --slurm writes the results\n"
        )
        return 0


def array_script(
    command: Sequence[str], numbers: Sequence[int], work: Path, environment: Mapping[str, str]
) -> str:
    """Return the text of a Slurm array script; the tasks' logs are written in the work folder.

    Args:
        command: Words of the command that runs one job, without the last one, the job's number.
        numbers: Numbers of the unfinished jobs, increasing.
        work: Absolute path of the work folder.
        environment: Variables of the jobs' processes, by name.

    Returns:
        A bash script with a task for each number.
    """
    lines = [
        "#!/bin/bash",
        "#SBATCH --job-name=socialiq-sweep",
        f"#SBATCH --array={ranges(numbers)}",
        "#SBATCH --cpus-per-task=1",
        f"#SBATCH --output={str(work).replace('%', '%%')}/slurm-%a.log",
        "# A task whose job is finished ends at once, so the script may be submitted again.",
        *(f"export {name}={shlex.quote(value)}" for name, value in environment.items()),
        f'exec {shlex.join(command)} "$SLURM_ARRAY_TASK_ID"',
    ]
    return "\n".join(lines) + "\n"


def ranges(numbers: Sequence[int]) -> str:
    """Return increasing numbers as Slurm writes them: 0-3,5."""
    script: list[list[int]] = []
    for number in numbers:
        if script and number == script[-1][1] + 1:
            script[-1][1] = number
        else:
            script.append([number, number])
    return ",".join(f"{a}-{b}" if b > a else f"{a}" for a, b in script)
