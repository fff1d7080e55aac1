"""Jobs that fill folders: what is done again, and that a folder is whole or a part."""

import json
from dataclasses import dataclass, replace

import pytest

from socialiq.errors import UserError
from socialiq.learners.callbacks import PARTS, Report
from socialiq_lab import jobs as jobs_module
from socialiq_lab.jobs import (
    WHOLE,
    Job,
    Progress,
    callbacks_of,
    claimed,
    do,
    fingerprints,
    open_jobs,
)


@dataclass(frozen=True)
class Config:
    value: int = 1
    sizes: tuple[int, ...] = (2, 3)


def add(config, folder, inputs, on_progress):
    """Its value and its inputs' together; it notes that it was called."""
    value = config.value + sum(int((one / "value").read_text()) for one in inputs.values())
    (folder / "value").write_text(str(value))
    with (folder.parent / "calls").open("a") as calls:
        calls.write(f"{folder.name} ")
    on_progress(0.5)


def fail(config, folder, inputs, on_progress):
    (folder / "half").write_text(str(config.value))
    raise UserError("the ink is out")


def finish(config, folder, inputs, on_progress):
    """Goes on from what `fail` has left, if it has."""
    half = folder / "half"
    (folder / "found").write_text(half.read_text() if half.exists() else "nothing")


A = Job("a", add, Config(1))
B = Job("b", add, Config(10), ("a",))
C = Job("c", add, Config(100))
D = Job("d", add, Config(1000), ("b", "c"))
ALL = [A, B, C, D]


def do_open(jobs, work):
    """Do what is open; returns what was called, in order."""
    (work / "calls").write_text("")
    known = fingerprints(jobs)
    for job in open_jobs(jobs, work):
        do(job, work, known[job.name], lambda share: None)
    return (work / "calls").read_text().replace(".part", "").split()


def values(work):
    return {name: int((work / name / "value").read_text()) for name in "abcd"}


def test_jobs_read_the_folders_of_their_inputs_and_are_done_once(tmp_path):
    assert do_open(ALL, tmp_path) == ["a", "b", "c", "d"]
    assert values(tmp_path) == {"a": 1, "b": 11, "c": 100, "d": 1111}
    assert do_open(ALL, tmp_path) == []


@pytest.mark.parametrize(
    ("number", "redone"), [(0, ["a", "b", "d"]), (1, ["b", "d"]), (2, ["c", "d"]), (3, ["d"])]
)
def test_a_job_that_changed_is_done_again_and_so_are_those_that_read_it(tmp_path, number, redone):
    do_open(ALL, tmp_path)
    changed = [*ALL]
    changed[number] = replace(ALL[number], config=Config(5))
    assert do_open(changed, tmp_path) == redone
    assert values(tmp_path)["d"] == 1111 - ALL[number].config.value + 5
    assert do_open(changed, tmp_path) == []


@pytest.mark.parametrize(
    "changed",
    [Job("c", finish, C.config), Job("c", add, Config(100, (2,))), replace(C, inputs=("a",))],
)
def test_a_fingerprint_is_of_function_configuration_and_inputs(changed):
    assert fingerprints([A, changed])["c"] != fingerprints([A, C])["c"]


def test_a_fingerprint_is_not_of_the_cost_or_of_other_jobs():
    assert fingerprints([A, replace(C, cost=9.0)])["c"] == fingerprints([C])["c"]


def test_another_version_of_the_package_does_all_again(tmp_path, monkeypatch):
    do_open(ALL, tmp_path)
    monkeypatch.setattr(jobs_module.importlib.metadata, "version", lambda name: "0.0.0")
    assert do_open(ALL, tmp_path) == ["a", "b", "c", "d"]


def test_the_record_says_what_was_done(tmp_path):
    do_open(ALL, tmp_path)
    record = json.loads((tmp_path / "b" / "job.json").read_text())
    assert record["fingerprint"] == fingerprints(ALL)["b"]
    assert record["config"] == {"value": 10, "sizes": [2, 3]}
    assert record["inputs"] == ["a"]
    assert {path.name for path in (tmp_path / "b").iterdir()} == {"job.json", "value"}


def test_a_job_that_fails_leaves_a_part_and_nothing_finished(tmp_path):
    job = Job("stage/x", fail, Config())
    with pytest.raises(UserError, match=r"^the ink is out$"):
        do_open([job], tmp_path)
    assert not (tmp_path / "stage" / "x").exists()
    assert (tmp_path / "stage" / "x.part" / "half").exists()
    assert open_jobs([job], tmp_path) == [job]


def test_a_finished_folder_stays_whole_until_its_successor_is(tmp_path):
    do_open([A], tmp_path)
    with pytest.raises(UserError):
        do_open([replace(A, work=fail)], tmp_path)
    assert (tmp_path / "a" / "value").read_text() == "1"
    assert open_jobs([A], tmp_path) == []
    do_open([replace(A, config=Config(2))], tmp_path)
    assert (tmp_path / "a" / "value").read_text() == "2"
    assert not (tmp_path / "a.part").exists()


@pytest.mark.parametrize(("now", "found"), [("same", "1"), ("other", "nothing")])
def test_a_part_is_used_again_by_the_same_job_alone(tmp_path, now, found):
    with pytest.raises(UserError):
        do(Job("x", fail, Config(1)), tmp_path, "same", lambda share: None)
    do(Job("x", finish, Config(1)), tmp_path, now, lambda share: None)
    assert (tmp_path / "x" / "found").read_text() == found
    assert (tmp_path / "x" / "half").exists() == (found == "1")


def test_a_part_that_nobody_signed_is_removed(tmp_path):
    (tmp_path / "x.part").mkdir()
    (tmp_path / "x.part" / "half").write_text("7")
    do(Job("x", finish, Config(1)), tmp_path, "same", lambda share: None)
    assert (tmp_path / "x" / "found").read_text() == "nothing"


def test_two_jobs_of_one_name_are_refused():
    with pytest.raises(UserError, match=r"^two jobs are called a$"):
        fingerprints([A, B, replace(A, config=Config(2))])


def test_a_folder_in_use_is_refused_until_it_is_let_go(tmp_path):
    work = tmp_path / "deep" / "work"
    refused = pytest.raises(UserError, match=r"work is in use by another run: wait for it, or sto")
    with claimed(work), refused, claimed(work):
        pytest.fail("claimed twice")
    with claimed(work):
        assert work.is_dir()


@pytest.mark.parametrize("taken", ["work", "work/stage", "work/stage/x.part"])
def test_a_place_that_cannot_be_written_is_refused_in_one_line(tmp_path, taken):
    """A file stands where a folder is wanted; permissions don't stop root."""
    (tmp_path / taken).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / taken).write_text("mine")
    job = Job("stage/x", finish, Config())
    refused = pytest.raises(UserError, match=r"^cannot write .*; choose another place$")
    with refused, claimed(tmp_path / "work"):
        do(job, tmp_path / "work", "any", lambda share: None)
    assert (tmp_path / taken).read_text() == "mine"


def test_progress_by_hand(monkeypatch):
    """Of stage s, costs 1 and 3, the first job takes 10 s: 30 s are left, at 3 jobs a minute."""
    now, reports = [100.0], []
    monkeypatch.setattr(jobs_module.time, "monotonic", lambda: now[0])
    work = [
        Job("s/a", add, Config()),
        Job("s/b", add, Config(), cost=3.0),
        Job("t/a", add, Config()),
    ]

    def on_stage(stage):
        return lambda report: reports.append((stage, report))

    progress = Progress(work, work, on_stage)
    progress.begin("s/a")
    now[0] = 105.0
    progress.update("s/a", 0.5)
    now[0] = 110.0
    progress.update("s/a", 1.0)
    progress.begin("t/a")
    progress.update("t/a", 1.0)
    whole = [(report.done, report.total, report.unit) for s, report in reports if s == WHOLE]
    assert whole == [(0, 3, PARTS), (1, 3, PARTS), (2, 3, PARTS)]
    # Costs of 5 in all: 1 of them takes 10 s, the second no time.
    left = [report.seconds_left for s, report in reports if s == WHOLE]
    assert left == pytest.approx([45.0, 40.0, 15.0])
    reports = [report for report in reports if report[0] != WHOLE]
    stage, report = reports[1]
    assert (stage, report.done, report.total, report.unit) == ("s", 1, 2, "jobs/min")
    assert (report.rate, report.seconds_left) == pytest.approx((3.0, 30.0))
    assert [(stage, report.done, report.total) for stage, report in reports] == [
        ("s", 0, 2),
        ("s", 1, 2),
        ("t", 1, 1),
    ]


def test_what_was_done_before_does_not_count_for_the_pace(monkeypatch):
    now, reports = [0.0], []
    monkeypatch.setattr(jobs_module.time, "monotonic", lambda: now[0])
    work = [Job(f"s/{name}", add, Config()) for name in "abcd"]
    progress = Progress(work, work[2:], lambda stage: reports.append)
    progress.begin("s/c")
    now[0] = 20.0
    progress.update("s/c", 1.0)
    assert (reports[-1].done, reports[-1].seconds_left) == (3, pytest.approx(20.0))


def test_nobody_need_watch():
    stages: list[str] = []
    progress = Progress([A], [A], stages.append)  # which returns no callback
    progress.begin("a")
    progress.update("a", 1.0)
    assert stages == [WHOLE, A.stage]


def test_a_training_is_a_share_of_its_job_and_resumes_from_the_file_that_is_there(tmp_path):
    shares, file = [], tmp_path / "checkpoint"
    callbacks = callbacks_of(shares.append, file, done=0.5, share=0.25)
    for done in (0, 20, 40):
        callbacks.on_report(Report(done, 40, 1.0, 0.0, {}, {}, ()))
    assert shares == [0.5, 0.625, 0.75] and not callbacks.resume
    file.touch()
    assert callbacks_of(shares.append, file).resume and not callbacks_of(shares.append).resume
