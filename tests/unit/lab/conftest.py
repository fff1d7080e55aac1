"""A module of quick jobs that other processes can import, and processes that run them."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.patience import wait_until

import socialiq
import socialiq_lab
from socialiq_lab.cluster import PORTABLE

QUICK_JOBS = '''
import os
import signal
import time
from dataclasses import dataclass

from socialiq.errors import UserError
from socialiq.learners.callbacks import Stopped, stop_requests
from socialiq.storage import write_atomically


@dataclass(frozen=True)
class Config:
    value: int = 0


def add(config, folder, inputs, on_progress):
    """Sum its value and those of its inputs; note the call."""
    value = config.value + sum(int((path / "value").read_text()) for path in inputs.values())
    with (folder.parent / "calls").open("a") as calls:
        calls.write(f"{folder.name} ")
    on_progress(0.5)
    (folder / "value").write_text(str(value))


def fail(config, folder, inputs, on_progress):
    raise UserError("the ink is out")


def divide(config, folder, inputs, on_progress):
    (folder / "value").write_text(str(1 / config.value))


def die_at_first(config, folder, inputs, on_progress):
    if not (folder / "tried").exists():
        (folder / "tried").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    (folder / "value").write_text(str(config.value))


def die_in_a_write_at_first(config, folder, inputs, on_progress):
    if not (folder / "tried").exists():
        (folder / "tried").touch()
        os.fsync = lambda file: os.kill(os.getpid(), signal.SIGKILL)
    write_atomically(folder / "value", str(config.value))


def die(config, folder, inputs, on_progress):
    with (folder / "tries").open("a") as tries:
        tries.write("x")
    os.kill(os.getpid(), signal.SIGKILL)


def stop_at_first(config, folder, inputs, on_progress):
    """Listen for a request to stop, keep the state and go on from it, as training does."""
    if not (folder / "half").exists():
        with stop_requests() as stop:
            (folder / "half").touch()
            if stop.wait():
                raise Stopped("half is done")
    (folder / "value").write_text(str(config.value))


def linger(config, folder, inputs, on_progress):
    """Listen to nothing."""
    (folder / "pid").write_text(str(os.getpid()))
    (folder / "half").touch()
    time.sleep(config.value)
    (folder / "value").write_text(str(config.value))


def meet(config, folder, inputs, on_progress):
    """Wait until another job does this too, at most so many seconds."""
    (folder.parent / f"{folder.name}.here").touch()
    for _ in range(10 * config.value):
        if len(list(folder.parent.glob("*.here"))) > 1:
            return (folder / "value").write_text(str(config.value))
        time.sleep(0.1)
    raise UserError("no other job came")


def count(config, folder, inputs, on_progress):
    """Add 20 numbers, one after another, and keep the last sum as training keeps its state."""
    value = config.value + sum(int((path / "value").read_text()) for path in inputs.values())
    state = folder / "state"
    step, total = map(int, state.read_text().split()) if state.exists() else (0, value)
    (folder / "pid").write_text(str(os.getpid()))
    while step < 20:
        time.sleep(0.02)
        step, total = step + 1, (31 * total + step) % 1_000_003
        (folder / "state.new").write_text(f"{step} {total}")
        (folder / "state.new").rename(state)
        on_progress(step / 20)
    (folder / "pid").unlink()
    (folder / "value").write_text(str(total))


def two_chains(job, work):
    """Make two chains of three jobs."""
    return [job(f"s/{n}", work, Config(n), (f"s/{n - 2}",) * (n > 1)) for n in range(6)]
'''


@pytest.fixture(name="quick", scope="session")
def module_of_quick_jobs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("quick")
    (folder / "quick_jobs.py").write_text(QUICK_JOBS)
    sys.path.insert(0, str(folder))  # a spawned process gets a copy of it
    yield importlib.import_module("quick_jobs")
    sys.path.remove(str(folder))
    del sys.modules["quick_jobs"]


@pytest.fixture(name="start")
def processes_that_end_with_the_test(quick):
    """Start a Python process that can import the quick jobs."""
    started = []
    packages = [str(Path(module.__file__).parents[1]) for module in (socialiq, socialiq_lab)]
    path = [str(Path(quick.__file__).parent), *packages]

    def start(*arguments, **variables):
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path), **variables}
        process = subprocess.Popen(
            [sys.executable, *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            start_new_session=True,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture(name="start_cluster")
def clusters_on_the_loopback(start, tmp_path):
    """Start a scheduler and workers; return its file and the processes."""

    def begin(workers=2, *further, **variables):
        file = tmp_path / "scheduler.json"
        file.unlink(missing_ok=True)
        usual = ["--no-dashboard", "--scheduler-file", file]
        scheduler = start("-m", "dask", "scheduler", "--host", "127.0.0.1", "--port", 0, *usual)
        # The scheduler makes its file first and fills it then.
        wait_until(lambda: file.exists() and file.read_text().rstrip().endswith("}"))
        options = ["--nthreads", 1, "--local-directory", tmp_path / "scratch", *usual, *further]
        arguments = ["-m", "dask", "worker", "--host", "127.0.0.1", *options]
        variables = {**PORTABLE, "OMP_NUM_THREADS": "1", **variables}
        return file, scheduler, [start(*arguments, **variables) for _ in range(workers)]

    return begin
