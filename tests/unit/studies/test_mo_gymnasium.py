"""The study of MO-Gymnasium without MO-Gymnasium: pieces, what is left to do, measures by hand."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.storage import packaged_results
from socialiq_lab.registry import find
from socialiq_lab.study import Context, run
from studies.mo_gymnasium import study, training
from studies.mo_gymnasium.study import Config
from studies.mo_gymnasium.tasks import ANGLES, FOLDER, TASKS, Piece, Task, read, within
from studies.mo_gymnasium.training import DIAL, METHODS, STANDARDISED

STUDY = find("mo-gymnasium")
TASK = "mo-halfcheetah"
PIECE = Piece(
    task=TASK,
    method=DIAL,
    seed=200,
    steps=TASKS[TASK].steps,
    evaluation_steps_while_training=0,
    angles=None,
    totals=[[300.0, -500.0], [0.0, 0.0]],
    settings={},
    seconds=1.0,
    versions={},
)


@pytest.fixture(name="pieces")
def folder_of_pieces(tmp_path):
    for seed in (200, 201):
        for method in METHODS:
            one = dataclasses.replace(PIECE, seed=seed, method=method)
            (tmp_path / one.file).write_bytes(one.content())
    peer = dataclasses.replace(PIECE, seed=300, method="CAPQL")
    (tmp_path / peer.file).write_bytes(peer.content())
    return tmp_path


def test_a_piece_is_read_as_it_was_written(pieces):
    found = read(pieces)
    assert len(found) == 2 * len(METHODS) + 1
    assert dataclasses.replace(PIECE, seed=300, method="CAPQL") in found
    assert read(pieces / "nowhere") == []


@pytest.mark.parametrize(
    "change",
    [
        {"task": "chess"},
        {"totals": [[1.0, 2.0, 3.0]]},
        {"totals": []},
        {"totals": [[1.0, float("nan")]]},
        {"angles": [0.0]},
        {"seed": 7},
        {"more": 1},
    ],
)
def test_a_file_that_is_no_piece_is_named(tmp_path, change):
    content = json.dumps(dataclasses.asdict(PIECE) | change)
    (tmp_path / PIECE.file).write_text(content)
    with pytest.raises(UserError, match=PIECE.file) as refused:
        read(tmp_path)
    assert "\n" not in str(refused.value)


def test_what_is_there_is_not_made_again(pieces):
    config = Config(tasks=(TASK,), seeds=(200, 201, 202), pieces=str(pieces))
    jobs = study.jobs(config)
    assert [job.config.seeds for job in jobs] == [(202,)] * len(METHODS)
    assert study.jobs(dataclasses.replace(config, seeds=(201,))) == []
    again = study.jobs(dataclasses.replace(config, seeds=(201,), again=True))
    assert len(again) == len(METHODS)
    assert study.jobs(dataclasses.replace(config, train=False)) == []
    # Pieces of another number of steps are those of another comparison.
    other = study.jobs(dataclasses.replace(config, seeds=(201,), steps=500))
    assert [job.config.steps for job in other] == [500] * len(METHODS)


def test_tables_and_files_come_from_the_pieces(pieces):
    config = Config(tasks=(TASK,), seeds=(200, 201), pieces=str(pieces))
    found = run(STUDY, config)
    rows = {row["method"]: row for row in found.tables["pooled"]}
    assert list(rows) == [*METHODS, "CAPQL"]
    assert [row["runs"] for row in rows.values()] == [2] * len(METHODS) + [1]
    # The reference is (-100, -6000): 400 x 5500 of the first, and 100 x 500 above it.
    assert rows["CAPQL"]["hypervolume"] == 2_250_000.0
    weights = np.array([[np.cos(one), np.sin(one)] for one in np.radians(ANGLES)])
    best = np.maximum(weights @ [300.0, -500.0], 0.0).mean()
    assert rows[DIAL]["expected_utility"] == pytest.approx(best, abs=1e-5)
    assert rows[DIAL]["mean_loss"] == ""  # no front is known
    there = {row["method"]: (row["runs"], row["of"]) for row in found.tables["coverage"]}
    assert there == dict.fromkeys(METHODS, (2, 2)) | {"CAPQL": (1, 2), "GPI-LS": (0, 2)}
    assert [len(view.rows) for view in STUDY.view(found)] == [
        len(METHODS) + 1,
        len(study.COMPARED),
        2,
    ]
    tested = [(row["first"], row["second"]) for row in found.tables["comparisons"]]
    assert tested == [(STANDARDISED, DIAL)] * len(study.COMPARED)  # the peer has one run
    assert found.tables["runs"][0]["second_rises"] == ""  # a set of policies has no angles
    assert set(found.files) == {f"{FOLDER}/{path.name}" for path in pieces.iterdir()}
    assert STUDY.figures(found).keys() == {"hypervolumes"}


def test_tasks_with_discrete_actions_have_no_standardised_dial():
    config = Config()
    assert STANDARDISED in config.methods_of(TASK)
    assert STANDARDISED not in config.methods_of("deep-sea-treasure")


def test_pieces_of_another_budget_are_left_out():
    steps = {TASK: 1000}
    early = dataclasses.replace(PIECE, steps=400, settings={"allowed_steps": 1000})
    other = dataclasses.replace(early, settings={"allowed_steps": 500})
    assert within([early, other], steps) == [early]
    # A piece that doesn't say what it was allowed is told by its steps.
    unsaid = [dataclasses.replace(PIECE, steps=count) for count in (400, 950, 1000, 1001)]
    assert [one.steps for one in within(unsaid, steps)] == [950, 1000]
    assert within([early], {"mo-swimmer": 1000}) == []


def test_the_dial_is_tested_against_each_peer():
    def rows(method, first):
        return [
            {"task": TASK, "method": method, "hypervolume": first + seed, "expected_utility": 1.0}
            for seed in range(5)
        ]

    found = study.comparison_rows(
        [*rows(DIAL, 10.0), *rows("experts", 0.0), *rows("CAPQL", 5.0), *rows("GPI-LS", 10.0)[:1]]
    )
    # One run of a peer is not compared, and ours are not tested against each other.
    assert [(row["second"], row["measure"]) for row in found] == [
        ("CAPQL", "hypervolume"),
        ("CAPQL", "expected_utility"),
    ]
    # All of the dial's are above: 2 of the 252 divisions are as extreme, and there are two tests.
    assert found[0]["value"] == 5.0 and found[0]["low"] < 5.0 < found[0]["high"]
    assert found[0]["p"] == pytest.approx(2 / 252)
    assert found[0]["p_holm_task"] == found[0]["p_holm"] == pytest.approx(4 / 252)
    assert found[1]["p"] == found[1]["p_holm"] == 1.0


def test_holm_is_within_a_task_and_over_all():
    rows = [
        {"task": task, "method": method, "hypervolume": first + seed, "expected_utility": 1.0}
        for task in ("a", "b")
        for method, first in ((DIAL, 10.0), ("CAPQL", 5.0))
        for seed in range(5)
    ]
    found = study.comparison_rows(rows)
    of_tasks = [row["p_holm_task"] for row in found]
    assert of_tasks == pytest.approx([4 / 252, 1.0, 4 / 252, 1.0])
    assert [row["p_holm"] for row in found] == pytest.approx([8 / 252, 1.0, 8 / 252, 1.0])


def test_the_utility_that_is_asked_for_takes_no_better_policy():
    totals = [[300.0, -500.0]] * (len(ANGLES) - 1) + [[0.0, 0.0]]
    turned = dataclasses.replace(PIECE, angles=list(ANGLES), totals=totals)
    row = study.measured(turned)
    weights = np.array([[np.cos(one), np.sin(one)] for one in np.radians(ANGLES[:-1])])
    asked = (weights @ [300.0, -500.0]).sum() / len(ANGLES)
    assert row["asked_utility"] == pytest.approx(asked)
    assert row["second_rises"] == pytest.approx(500.0)
    assert row["asked_utility"] < row["expected_utility"]


def test_no_piece_makes_empty_tables(tmp_path):
    config = Config(tasks=(TASK,), methods=(), pieces=str(tmp_path))
    assert study.compute_tables(config, Context((), tmp_path, lambda _: None)).files == {}


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--set", "tasks=chess"], "unknown task 'chess'"),
        (["--set", "methods=luck"], "unknown method 'luck'"),
        (["--set", "steps=-3"], "steps must be at least 1"),
        (["--set", "pieces=nowhere"], "nowhere is no folder"),
    ],
)
def test_a_mistyped_call_is_one_line(words, line, capsys, tmp_path):
    out = str(tmp_path / "out")
    assert main(["reproduce", "mo-gymnasium", *words, "--out", out]) == 2
    err = capsys.readouterr().err
    assert line in err and err.count("\n") == 1


def test_committed_pieces_give_the_committed_table():
    folder = packaged_results() / "mo-gymnasium"
    from socialiq.results_folder import load

    committed = {
        (row["task"], row["method"]): row["hypervolume"] for row in load(folder).tables["pooled"]
    }
    pooled = study.pooled([study_row(one) for one in read(folder / FOLDER)])
    assert pooled
    for row in pooled:
        wanted = committed[row["task"], row["method"]]
        assert row["hypervolume"] == pytest.approx(wanted, rel=1e-5)


def study_row(piece):
    """Return the measures that need no exact front."""
    points = piece.points
    area = study.hypervolume(points, np.array(TASKS[piece.task].reference))
    label = {"task": piece.task, "method": piece.method, "steps": piece.steps}
    empty = dict.fromkeys(study.MEASURES, "")
    return label | empty | {"hypervolume": area}


@pytest.fixture(name="budgets")
def stubs_of_learners(monkeypatch):
    """Learners that note the steps that they are given, and episodes of ten steps."""
    calls = []

    def value_dials(_task, steps, seeds, datasets=(), only=None):
        calls.append((steps, len(datasets), only))
        return [SimpleNamespace(at=lambda angle: angle) for _ in seeds]

    shown = SimpleNamespace(n_transitions=60)
    monkeypatch.setattr(training, "value_dials", value_dials)
    monkeypatch.setattr(training, "demonstrations", lambda *_inputs: shown)
    monkeypatch.setattr(
        training, "train_trio", lambda _task, _data, seeds: [[1, 2, 3]] * len(seeds)
    )
    monkeypatch.setattr(Task, "time_limit", lambda _task: 10)
    return calls


@pytest.mark.parametrize(
    ("method", "taken", "calls"),
    [
        ("dial", 2000, [(2000, 0, None)]),
        # Three experts of 2,050 / 3 steps, in whole rounds of 100.
        ("experts", 1800, [(600, 0, angle) for angle in (0.0, 45.0, 90.0)]),
        # 60 steps are reserved for the episodes, and 60 are taken.
        ("IQ-Learn trio", 1860, [(600, 0, angle) for angle in (0.0, 45.0, 90.0)]),
        (
            "dial from demonstrations",
            900 + 60 + 1000,
            [*((300, 0, angle) for angle in (0.0, 45.0, 90.0)), (1000, 2, None)],
        ),
    ],
)
def test_every_method_takes_at_most_the_steps_of_the_task(budgets, method, taken, calls):
    task = dataclasses.replace(TASKS["deep-sea-treasure"], steps=2050)
    policies, steps, settings = training.trained(task, method, (1, 2))
    assert steps == taken <= task.steps and budgets == calls and len(policies) == 2
    assert settings["hidden"] == list(task.hidden) and settings["temperature"] == 0.01
    expert = 600 if method == "IQ-Learn trio" else 300
    assert settings.get("steps_of_an_expert", expert) == expert


@pytest.mark.parametrize("method", ["dial from demonstrations", "dial, standardised"])
def test_too_few_steps_are_one_line(budgets, method):
    task = dataclasses.replace(TASKS["deep-sea-treasure"], steps=150)
    with pytest.raises(UserError, match="150 steps are too few"):
        training.trained(task, method, (1,))
    assert budgets == []


def test_whole_numbers_are_seen_one_place_each():
    assert training.one_hot(np.array([0, -2]), np.array([3, 1])) == ((0, 4), (-2, 4))
