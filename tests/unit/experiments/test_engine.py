"""Processes that do jobs: order, failures, kills and Ctrl-C, and the call that goes on from there.

A spawned process imports what it is told to do, so the chores stand in a module of their own.
"""

import importlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from socialiq.errors import UserError
from socialiq.experiments.engine import run_jobs
from socialiq.experiments.jobs import Job, claimed

CHORES = '''
import os
import signal
import time
from dataclasses import dataclass

from socialiq.errors import UserError
from socialiq.learners.callbacks import Stopped, stop_requests


@dataclass(frozen=True)
class Config:
    value: int = 0


def add(config, folder, inputs, tell):
    """Its value and its inputs' together; it notes that it was called."""
    value = config.value + sum(int((one / "value").read_text()) for one in inputs.values())
    with (folder.parent / "calls").open("a") as calls:
        calls.write(f"{folder.name} ")
    tell(0.5)
    (folder / "value").write_text(str(value))


def fail(config, folder, inputs, tell):
    raise UserError("the ink is out")


def die_at_first(config, folder, inputs, tell):
    if not (folder / "tried").exists():
        (folder / "tried").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    (folder / "value").write_text(str(config.value))


def stop_at_first(config, folder, inputs, tell):
    """As training does: it listens for Ctrl-C, keeps its state and goes on from it."""
    if not (folder / "half").exists():
        with stop_requests() as stop:
            (folder / "half").touch()
            if stop.wait(60):
                raise Stopped("half is done")
    (folder / "value").write_text(str(config.value))


def linger(config, folder, inputs, tell):
    """Does not listen for anything."""
    (folder / "pid").write_text(str(os.getpid()))
    (folder / "half").touch()
    time.sleep(config.value)
    (folder / "value").write_text(str(config.value))
'''

COMMAND = """
import sys
from pathlib import Path
import chores
from socialiq.learners.callbacks import Stopped
from socialiq.experiments.jobs import Job
from socialiq.experiments.engine import run_jobs
work, name, value = sys.argv[1:]
jobs = [Job("before", chores.add, chores.Config(1))]
jobs += [Job("slow", getattr(chores, name), chores.Config(int(value)), ("before",))]
try:
    run_jobs(jobs, Path(work), lambda stage: None, processes=1)
except Stopped as stopped:
    sys.exit(str(stopped))
"""


@pytest.fixture(name="chores", scope="module")
def chores_module(tmp_path_factory):
    folder = tmp_path_factory.mktemp("chores")
    (folder / "chores.py").write_text(CHORES)
    sys.path.insert(0, str(folder))  # a spawned process gets a copy of it
    yield importlib.import_module("chores")
    sys.path.remove(str(folder))
    del sys.modules["chores"]


@pytest.fixture(name="command")
def command_on_a_work_folder(chores, tmp_path):
    """A process of its own that does a quick job and a slow one."""
    started = []

    def start(name, value=5):
        environment = os.environ | {"PYTHONPATH": str(Path(chores.__file__).parent)}
        arguments = [sys.executable, "-c", COMMAND, str(tmp_path), name, str(value)]
        process = subprocess.Popen(
            arguments, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def until(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it never came to that"
        time.sleep(0.02)


def unwatched(stage):
    return None


def runs(pid):
    """Whether a process is there and is not a zombie that nobody has asked for."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_jobs_are_done_after_their_inputs_and_once(chores, tmp_path):
    def jobs(value):
        return [
            Job("s/a", chores.add, chores.Config(value)),
            Job("s/b", chores.add, chores.Config(10), ("s/a",)),
            Job("s/c", chores.add, chores.Config(100)),
            Job("s/d", chores.add, chores.Config(1000), ("s/b", "s/c")),
        ]

    def called():
        names = (tmp_path / "s" / "calls").read_text().replace(".part", "").split()
        (tmp_path / "s" / "calls").write_text("")
        return names

    reports = []
    run_jobs(jobs(1), tmp_path, lambda stage: reports.append, processes=2)
    order = called()
    assert sorted(order) == ["a", "b", "c", "d"]
    assert order.index("a") < order.index("b") and order[-1] == "d"
    assert (tmp_path / "s" / "d" / "value").read_text() == "1111"
    assert len(reports) == 8 and reports[-1].done == reports[-1].total == 4
    run_jobs(jobs(1), tmp_path, unwatched)
    assert called() == []
    run_jobs(jobs(2), tmp_path, unwatched, processes=1)
    assert called() == ["a", "b", "d"]
    assert (tmp_path / "s" / "d" / "value").read_text() == "1112"


def test_a_job_that_fails_is_named_and_leaves_nothing_finished(chores, tmp_path):
    jobs = [
        Job("good", chores.add, chores.Config(1)),
        Job("bad", chores.fail, chores.Config(), ("good",)),
        Job("after", chores.add, chores.Config(), ("bad",)),
    ]
    with pytest.raises(UserError, match=r"^bad: the ink is out$"):
        run_jobs(jobs, tmp_path, unwatched, processes=1)
    assert (tmp_path / "good" / "job.json").is_file()
    assert not (tmp_path / "bad").exists() and not (tmp_path / "after").exists()
    with claimed(tmp_path):
        pass  # it has let go of the folder


def test_a_killed_process_is_told_and_the_next_call_goes_on(chores, tmp_path):
    jobs = [
        Job("before", chores.add, chores.Config(1)),
        Job("x", chores.die_at_first, chores.Config(7), ("before",)),
    ]
    line = r"^the process that did x was killed; give the same command to go on$"
    with pytest.raises(UserError, match=line):
        run_jobs(jobs, tmp_path, unwatched, processes=1)
    assert not (tmp_path / "x").exists()
    run_jobs(jobs, tmp_path, unwatched, processes=1)
    assert (tmp_path / "x" / "value").read_text() == "7"
    assert (tmp_path / "calls").read_text() == "before.part "


@pytest.mark.parametrize("send", [os.kill, os.killpg], ids=["parent", "terminal"])
def test_ctrl_c_stops_and_the_same_command_goes_on(command, tmp_path, send):
    """From `kill` it reaches the command alone, from a terminal its workers too."""
    process = command("stop_at_first")
    until((tmp_path / "slow.part" / "half").exists)
    send(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert errors == "stopped: what is finished is kept; give the same command to go on\n"
    assert not (tmp_path / "slow").exists()

    again = command("stop_at_first")
    _, errors = again.communicate(timeout=60)
    assert (again.returncode, errors) == (0, "")
    assert (tmp_path / "slow" / "value").read_text() == "5"
    assert (tmp_path / "calls").read_text() == "before.part "


def test_ctrl_c_ends_a_job_that_does_not_listen(command, tmp_path):
    process = command("linger", 1)
    until((tmp_path / "slow.part" / "half").exists)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=10)
    assert errors == "stopped: what is finished is kept; give the same command to go on\n"


def test_nobody_outlives_a_command_that_was_killed(command, tmp_path):
    process, part = command("linger", 300), tmp_path / "slow.part"
    until((part / "half").exists)
    worker = int((part / "pid").read_text())
    assert runs(worker)
    with pytest.raises(UserError, match="in use by another run"), claimed(tmp_path):
        pytest.fail("claimed twice")
    process.kill()
    process.wait()
    until(lambda: not runs(worker), 10)
    with claimed(tmp_path):
        assert not (tmp_path / "slow").exists()


def test_a_folder_that_cannot_be_made_is_refused_before_any_work(chores, tmp_path):
    (tmp_path / "work").write_text("mine")
    with pytest.raises(UserError, match=r"^cannot write .*work: File exists; choose another place"):
        run_jobs([Job("a", chores.add, chores.Config())], tmp_path / "work", unwatched)
