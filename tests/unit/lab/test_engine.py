"""Jobs on a local Dask cluster: order, failures, kills, Ctrl-C, and what the next call does.

A spawned process imports the functions of its jobs, so they stand in a module of their own.
"""

import os
import signal
from pathlib import Path

import pytest
from tests.patience import HANG, LONGER, is_running, wait_until

from socialiq.errors import UserError
from socialiq_lab.engine import Engine, run_jobs
from socialiq_lab.jobs import Job, claimed

COMMAND = """
import sys
from pathlib import Path
import quick_jobs
from socialiq.learners.callbacks import Stopped
from socialiq_lab.jobs import Job
from socialiq_lab.engine import run_jobs
work, name, value = sys.argv[1:]
jobs = [Job("before", quick_jobs.add, quick_jobs.Config(1))]
jobs += [Job("slow", getattr(quick_jobs, name), quick_jobs.Config(int(value)), ("before",))]
try:
    run_jobs(jobs, Path(work), lambda stage: None, processes=1)
except Stopped as stopped:
    sys.exit(str(stopped))
"""


@pytest.fixture(name="command")
def command_on_a_work_folder(start, tmp_path):
    """A process of its own that does a quick job and a slow one."""
    return lambda name, value=5: start("-c", COMMAND, tmp_path, name, value)


def silent(stage):
    return None


def test_jobs_are_done_after_their_inputs_and_once(quick, tmp_path):
    def jobs(value):
        return [
            Job("s/a", quick.add, quick.Config(value)),
            Job("s/b", quick.add, quick.Config(10), ("s/a",)),
            Job("s/c", quick.add, quick.Config(100)),
            Job("s/d", quick.add, quick.Config(1000), ("s/b", "s/c")),
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
    assert len(reports) == 16  # of the stage, and of the whole run
    assert reports[-1].done == reports[-1].total == 4
    run_jobs(jobs(1), tmp_path, silent)
    assert called() == []
    run_jobs(jobs(2), tmp_path, silent, processes=1)
    assert called() == ["a", "b", "d"]
    assert (tmp_path / "s" / "d" / "value").read_text() == "1112"


def test_no_process_is_idle_while_a_job_is_ready(quick, tmp_path):
    # Dask's own placement put both jobs that meet at one process in a quarter of the runs.
    def job(number, work, seconds):
        return Job(f"s/{number}", work, quick.Config(seconds), ("before",))

    works = [(quick.linger, 1), (quick.meet, int(HANG))] * 2
    jobs = [Job("before", quick.linger, quick.Config(1))]
    jobs += [job(number, *work) for number, work in enumerate(works)]
    run_jobs(jobs, tmp_path, silent, processes=2)
    assert all((tmp_path / "s" / str(n) / "value").is_file() for n in range(4))


def test_a_job_that_fails_is_named_and_leaves_nothing_finished(quick, tmp_path):
    jobs = [
        Job("good", quick.add, quick.Config(1)),
        Job("bad", quick.fail, quick.Config(), ("good",)),
        Job("after", quick.add, quick.Config(), ("bad",)),
    ]
    with pytest.raises(UserError, match=r"^bad: the ink is out$"):
        run_jobs(jobs, tmp_path, silent, processes=1)
    assert (tmp_path / "good" / "job.json").is_file()
    assert not (tmp_path / "bad").exists() and not (tmp_path / "after").exists()
    with claimed(tmp_path):
        pass  # it has let go of the folder


def test_an_exception_becomes_one_line_and_its_traceback_is_kept(quick, tmp_path):
    line = r"^odd/half: ZeroDivisionError: division by zero; the traceback is in (.*error\.txt)$"
    with pytest.raises(UserError, match=line) as caught:
        run_jobs([Job("odd/half", quick.divide, quick.Config(0))], tmp_path, silent)
    note = Path(str(caught.value).rpartition(" ")[2])
    assert "1 / config.value" in note.read_text()


def test_a_job_whose_process_is_killed_is_tried_again(quick, tmp_path):
    jobs = [
        Job("before", quick.add, quick.Config(1)),
        Job("x", quick.die_at_first, quick.Config(7), ("before",)),
        Job("after", quick.add, quick.Config(10), ("x",)),
    ]
    run_jobs(jobs, tmp_path, silent, processes=1)
    assert (tmp_path / "after" / "value").read_text() == "17"
    assert (tmp_path / "calls").read_text() == "before.part after.part "


@pytest.mark.slow
def test_a_process_killed_in_a_write_leaves_no_part_of_the_file(quick, tmp_path):
    job = Job("x", quick.die_in_a_write_at_first, quick.Config(7))
    run_jobs([job], tmp_path, silent, processes=1)
    assert {path.name for path in (tmp_path / "x").iterdir()} == {"tried", "value", "job.json"}


@pytest.mark.slow
def test_a_job_that_kills_its_process_again_and_again_is_named(quick, tmp_path):
    jobs = [
        Job("before", quick.add, quick.Config(1)),
        Job("bad", quick.die, quick.Config(), ("before",)),
    ]
    line = r"^bad: its process was killed 4 times: see whether the memory suffices; what is fini"
    with pytest.raises(UserError, match=line):
        run_jobs(jobs, tmp_path, silent, processes=1)
    assert (tmp_path / "bad.part" / "tries").read_text() == "xxxx"
    assert (tmp_path / "before" / "value").read_text() == "1"


@pytest.mark.parametrize(
    "send", [pytest.param(os.kill, id="parent", marks=pytest.mark.slow), os.killpg]
)
def test_ctrl_c_stops_and_the_same_command_goes_on(command, tmp_path, send):
    """From `kill` it reaches the command alone, from a terminal its workers too."""
    process = command("stop_at_first")
    wait_until((tmp_path / "slow.part" / "half").exists)
    send(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=HANG)
    assert process.returncode == 1
    assert errors == "stopped: what is finished is kept; give the same command to go on\n"
    assert not (tmp_path / "slow").exists()

    again = command("stop_at_first")
    _, errors = again.communicate(timeout=HANG)
    assert (again.returncode, errors) == (0, "")
    assert (tmp_path / "slow" / "value").read_text() == "5"
    assert (tmp_path / "calls").read_text() == "before.part "


@pytest.mark.slow
def test_ctrl_c_ends_a_job_that_does_not_listen(command, tmp_path):
    process = command("linger", int(LONGER))
    wait_until((tmp_path / "slow.part" / "half").exists)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=HANG)
    assert errors == "stopped: what is finished is kept; give the same command to go on\n"


def test_nobody_outlives_a_command_that_was_killed(command, tmp_path):
    process, part = command("linger", int(LONGER)), tmp_path / "slow.part"
    wait_until((part / "half").exists)
    worker = int((part / "pid").read_text())
    assert is_running(worker)
    with pytest.raises(UserError, match="in use by another run"), claimed(tmp_path):
        pytest.fail("claimed twice")
    process.kill()
    process.wait()
    wait_until(lambda: not is_running(worker))
    with claimed(tmp_path):
        assert not (tmp_path / "slow").exists()


def test_a_folder_that_cannot_be_made_is_refused_before_any_work(quick, tmp_path):
    (tmp_path / "work").write_text("mine")
    with pytest.raises(UserError, match=r"^cannot write .*work: File exists; choose another place"):
        run_jobs([Job("a", quick.add, quick.Config())], tmp_path / "work", silent)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"processes": -1}, "processes must be at least 1, got -1"),
        ({"processes": 2, "cluster": "tcp://127.0.0.1:8786"}, "--processes is of this machine"),
    ],
)
def test_an_engine_that_says_nothing_is_refused(options, line):
    with pytest.raises(UserError, match=line):
        Engine(**options)
