"""Systems without `fcntl` and `resource`, such as Windows: the commands that need neither run."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

BLOCKED = """
import sys
sys.modules["fcntl"] = sys.modules["resource"] = None
import os
for name in ("sched_getaffinity", "sched_setaffinity"):
    if hasattr(os, name):
        delattr(os, name)
from socialiq.cli.main import main
"""


def run(folder: Path, *commands: list[str]) -> None:
    """Run commands one after another in a process that has neither module."""
    lines = [BLOCKED, *(f"assert main({command!r}) == 0, {command!r}" for command in commands)]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        cwd=folder,
        env=dict(os.environ),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_solve_claims_collect_and_train_need_neither(tmp_path):
    tiny = ["--updates", "4", "--set", "batch_size=4", "--hidden", "4"]
    run(
        tmp_path,
        ["solve", "crossing5"],
        ["claims"],
        ["collect", "crossing5", "--episodes", "2", "--out", "mixed.safetensors"],
        ["train", "iq-learn", "mixed.safetensors", "--world", "crossing5", "--out", "run", *tiny],
    )
    assert (tmp_path / "run" / "run.json").is_file()


def test_every_module_of_the_experiments_is_importable_without_them(tmp_path):
    modules = ["socialiq_lab.jobs", "socialiq_lab.engine", "studies.grid.study"]
    lines = [BLOCKED, *(f"import {module}" for module in (*modules, "socialiq.policies.load"))]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="the modules exist on this system only")
def test_the_block_works():
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED + "\nimport fcntl"], capture_output=True, check=False
    )
    assert done.returncode == 1
