"""The same jobs on a real scheduler and real workers: kills of any of them lose nothing."""

import json
import os
import signal
import threading

import pytest
from distributed import Client
from tests.patience import HANG, wait_until

from socialiq.errors import UserError
from socialiq.evaluation.parts import ONE_THREAD
from socialiq.worlds.highway import PORTABLE
from socialiq_lab import cluster as cluster_module
from socialiq_lab.engine import run_jobs
from socialiq_lab.jobs import Job

COMMAND = """
import sys
from pathlib import Path
import quick_jobs
from socialiq.errors import UserError
from socialiq_lab.jobs import Job
from socialiq_lab.engine import run_jobs
work, cluster = map(Path, sys.argv[1:])
jobs = quick_jobs.two_chains(Job, quick_jobs.count)
try:
    run_jobs(jobs, work, lambda stage: None, cluster=str(cluster))
except UserError as error:
    sys.exit(str(error))
"""


def silent(stage):
    return None


def jobs_of(quick):
    return quick.two_chains(Job, quick.count)


def files(work):
    """Content of the finished jobs' files; only the time that a job took may differ."""
    found = {}
    for path in sorted((work / "s").rglob("*")):
        if path.is_file() and ".part" not in str(path):
            content = path.read_text()
            if path.name == "job.json":
                content = json.loads(content)
                assert content.pop("seconds") >= 0
            found[str(path.relative_to(work))] = content
    return found


@pytest.fixture(name="undisturbed", scope="module")
def results_of_an_undisturbed_run(quick, tmp_path_factory):
    work = tmp_path_factory.mktemp("undisturbed")
    run_jobs(jobs_of(quick), work, silent, processes=2)
    found = files(work)
    assert len(found) == 18  # value, state and job.json of each job
    return found


def process_of(work, name):
    """The process of a job that has begun to count."""
    note, state = work / f"{name}.part" / "pid", work / f"{name}.part" / "state"
    wait_until(lambda: note.exists() and note.read_text() and state.exists())
    return int(note.read_text())


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_of_a_job_changes_nothing(
    quick, start_cluster, undisturbed, tmp_path
):
    file, _, _ = start_cluster()
    work, killed = tmp_path / "work", []

    def kill():
        killed.append(process_of(work, "s/2"))
        os.kill(killed[0], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    reports = []
    run_jobs(jobs_of(quick), work, lambda stage: reports.append, cluster=str(file))
    killer.join()
    assert killed and reports[-1].done == reports[-1].total == 6
    assert files(work) == undisturbed


@pytest.mark.slow
def test_a_command_killed_with_its_cluster_alive_is_given_again(
    start, start_cluster, undisturbed, tmp_path
):
    """The worker goes on with the job; the new command waits for it and does it no second time."""
    file, _, _ = start_cluster()
    work = tmp_path / "work"
    command = start("-c", COMMAND, work, file)
    process_of(work, "s/2")
    command.kill()
    command.wait()
    again = start("-c", COMMAND, work, file)
    assert again.communicate(timeout=HANG) == ("", "")
    assert again.returncode == 0
    assert files(work) == undisturbed


@pytest.mark.slow
def test_a_killed_scheduler_is_told_and_the_next_one_goes_on(
    start, start_cluster, undisturbed, tmp_path
):
    file, scheduler, workers = start_cluster()
    work = tmp_path / "work"
    command = start("-c", COMMAND, work, file)
    process_of(work, "s/2")
    finished = files(work)
    scheduler.kill()
    _, errors = command.communicate(timeout=HANG)
    line = "the scheduler is gone: what is finished is kept; start it again and give the same com"
    assert errors.startswith(line) and errors.count("\n") == 1
    for worker in workers:
        worker.kill()
    assert finished and finished.items() <= files(work).items()
    file, _, _ = start_cluster()
    again = start("-c", COMMAND, work, file)
    assert again.communicate(timeout=HANG) == ("", "")
    assert files(work) == undisturbed


@pytest.mark.slow
def test_ctrl_c_stops_the_jobs_of_the_cluster_and_leaves_its_workers(
    quick, start, start_cluster, tmp_path
):
    file, scheduler, workers = start_cluster()
    work = tmp_path / "work"
    code = COMMAND.replace("quick_jobs.count", "quick_jobs.stop_at_first")
    command = start("-c", code, work, file)
    wait_until((work / "s/0.part/half").exists)
    command.send_signal(signal.SIGINT)
    _, errors = command.communicate(timeout=HANG)
    assert errors == "stopped: what is finished is kept; give the same command to go on\n"
    assert all(process.poll() is None for process in (scheduler, *workers))
    again = start("-c", code, work, file)
    wait_until((work / "s/2.part/half").exists)  # s/0 has gone on from its half
    assert (work / "s/0/value").read_text() == "0"
    again.kill()


def test_a_worker_with_other_arithmetic_is_refused(quick, start_cluster, tmp_path):
    file, _, _ = start_cluster(1, OPENBLAS_CORETYPE="Zen")
    line = (
        r'^the worker on \S+ was not started with OPENBLAS_CORETYPE="Haswell": start it with `dask '
    )
    line += r"worker --preload-nanny socialiq_lab.cluster`$"
    with pytest.raises(UserError, match=line):
        run_jobs(jobs_of(quick), tmp_path / "work", silent, cluster=str(file))
    assert not (tmp_path / "work" / "s").exists()


def test_a_worker_of_our_preload_sets_its_variables_itself(quick, start_cluster, tmp_path):
    others = {"OPENBLAS_CORETYPE": "Zen", "NPY_DISABLE_CPU_FEATURES": "", "OMP_NUM_THREADS": "7"}
    file, _, _ = start_cluster(1, "--preload-nanny", "socialiq_lab.cluster", **others)
    run_jobs(jobs_of(quick), tmp_path / "work", silent, cluster=str(file))
    with Client(cluster_module.scheduler_address(file), set_as_default=False) as client:
        [variables] = client.run(lambda: dict(os.environ)).values()
    assert {**variables, **PORTABLE, **ONE_THREAD} == variables


def test_a_cluster_without_workers_is_told(quick, start_cluster, monkeypatch, tmp_path):
    monkeypatch.setattr(cluster_module, "_WORKERS_SECONDS", 0.5)
    file, _, _ = start_cluster(0)
    with pytest.raises(UserError, match=r"has no workers: start some with `dask worker`$"):
        run_jobs(jobs_of(quick), tmp_path / "work", silent, cluster=str(file))


@pytest.mark.parametrize("given", ["tcp://127.0.0.1:9", "nowhere.json", "http://x"])
def test_a_cluster_that_does_not_answer_is_told(quick, monkeypatch, tmp_path, given):
    monkeypatch.setattr(cluster_module, "_CONNECT_SECONDS", 0.5)
    with pytest.raises(UserError, match=f"^no Dask scheduler answers at {given}: start `dask "):
        run_jobs(jobs_of(quick), tmp_path / "work", silent, cluster=given)


def test_an_event_loop_that_starts_late_is_started_again():
    tries = []

    def late(answer: str) -> str:
        tries.append(answer)
        assert len(tries) > 1
        return answer

    assert cluster_module._started(late, "client") == "client"
    assert len(tries) == 2

    def never() -> None:
        raise AssertionError

    with pytest.raises(UserError, match=r"did not start: the machine is too busy"):
        cluster_module._started(never)


def test_a_folder_that_is_not_shared_and_another_version_are_told(monkeypatch, tmp_path):
    monkeypatch.setattr(cluster_module, "_SHARED_SECONDS", 0.0)
    described = cluster_module.describe()
    (tmp_path / ".call").write_text("of another")
    with pytest.raises(UserError, match=r"does not see .*: name a --work folder that all share$"):
        cluster_module.check(described, tmp_path, "this")
    (tmp_path / ".call").write_text("this")
    cluster_module.check(described, tmp_path, "this")
    with pytest.raises(UserError, match=r"has numpy .*, this process 1\.0$"):
        cluster_module.check(described | {"numpy": "1.0"}, tmp_path, "this")


@pytest.mark.parametrize(
    "content",
    ["[]", "{}", '{"address": 1}', '{"address": "tcp://a b:1"}', '{"address": "127.0.0.1:1"}'],
)
def test_a_file_that_names_no_scheduler_is_refused(tmp_path, content):
    (tmp_path / "scheduler.json").write_text(content)
    with pytest.raises(UserError, match="names no scheduler's address"):
        cluster_module.scheduler_address(tmp_path / "scheduler.json")
