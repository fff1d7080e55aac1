"""Slurm array scripts whose tasks each run an open job of a work folder."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path


def array_script(
    command: Sequence[str], numbers: Sequence[int], work: Path, environment: Mapping[str, str]
) -> str:
    """Return the text of an array script.

    Args:
        command: Words of the command that runs a job, without its number, which comes last.
        numbers: Numbers of the jobs that are not finished.
        work: Folder of all jobs' folders; the tasks' logs are written there.
        environment: Environment variables of the tasks.
    """
    exports = [f"export {name}={shlex.quote(value)}" for name, value in environment.items()]
    lines = [
        "#!/bin/bash",
        "#SBATCH --job-name=socialiq-sweep",
        f"#SBATCH --array={ranges(numbers)}",
        "#SBATCH --cpus-per-task=1",
        f"#SBATCH --output={str(work).replace('%', '%%')}/slurm-%a.log",
        "# A task whose job is finished ends at once, so the script may be submitted again.",
        *exports,
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
