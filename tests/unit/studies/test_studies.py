"""Studies that run in one process, each at a tiny size: what must hold of its tables."""

import math
import subprocess
import sys

import pytest
from tests.digest.studies import differs

from socialiq import results_folder as store
from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.evaluation.dial import sweep
from socialiq.evaluation.exact import Ground
from socialiq.nn.dial_policy import DialPolicy
from socialiq.settings import changed
from socialiq.storage import packaged_results
from socialiq_lab.registry import STUDIES, find, study_and_declaration
from socialiq_lab.study import run, save
from socialiq_lab.tables import matching

TINY = (
    "worlds",
    "poc",
    "grid",
    "lambda-sweep",
    "alternatives",
    "penalties",
    "theory",
    "dial",
    "off-policy",
    "audits",
    "audit-power",
    "audit-tests",
    "own-data",
)
"""Studies that run in one process."""

QUICK = ("audit-power",)
PARAMS = [pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow) for name in TINY]


@pytest.fixture(scope="module", params=PARAMS)
def tiny_run(request, tmp_path_factory):
    study, content = study_and_declaration(request.param)
    work = tmp_path_factory.mktemp("tiny") / "work"
    return study, run(study, changed(study.Config(), content["tiny"]), work=work), work


@pytest.fixture
def study(tiny_run):
    return tiny_run[:2]


def test_no_table_of_the_digest_differs(tiny_run):
    study, results, work = tiny_run
    assert differs(study.name, results, work) == []


def test_the_first_dial_lies_beside_its_results(study, tmp_path):
    found, results = study
    if found.name != "dial":
        return
    save(found, results, tmp_path / found.name, replace=False)
    dial = DialPolicy.load(tmp_path / found.name / "dial.safetensors")
    part = Ground.of("crossing7").with_clock(clock=True).part
    swept = sweep(dial, part, "greedy", (0.0, 45.0))
    rows = matching(results.tables["angles"], seed=0, readout="greedy")
    stored = {row["angle"]: row["r_env"] for row in rows}
    for angle, metrics in zip(swept.angles, swept.metrics, strict=True):
        assert metrics.r_env == pytest.approx(stored[angle], abs=1e-5)


def test_figures_and_summary_come_from_the_folder_alone(study, tmp_path):
    found, results = study
    save(found, results, tmp_path / found.name, replace=False)
    read = store.load(tmp_path / found.name)
    assert read.summary == results.summary
    assert read.tables.keys() == results.tables.keys()
    pictures = {path.stem: path.read_bytes() for path in (tmp_path / found.name).glob("*.png")}
    assert pictures.keys() == found.figures(read).keys()
    assert all(picture.startswith(b"\x89PNG") for picture in pictures.values())


def check_worlds(tables, _summary):
    assert tables["crossing5_readings"][0]["egoistic"] == "GGGG"
    for row in tables["crossing7_front"]:
        assert row["stationary_value"] <= row["value"] + 1e-6  # a clock can only help


def check_poc(tables, summary):
    for row in tables["sequences"]:
        assert set(row["sequence"]) <= set("WG")
        assert row["equal"] == (row["sequence"] == row["thesis"])
    equal = [row["equal"] for row in tables["sequences"]]
    assert sum(row["equal"] for row in tables["agreement"]) == sum(equal)
    assert summary["all_four"] == all(equal)  # one seed, one reading


def check_grid(tables, summary):
    for row in tables["policies"]:
        assert row["regret"] >= -1e-6  # the optimum is exact
        assert row["collision"] + row["arrival"] + row["timeout"] == pytest.approx(1, abs=1e-5)
    mine = [
        row["regret"]
        for row in tables["policies"]
        if (row["method"], row["mixture"]) == ("reward_regularized", "equal_trajectories")
        and (row["target_angle"], row["readout"]) == (45.0, "greedy")
        and (row["target_kind"], row["strength"]) == ("running", 2.0)
    ]
    assert len(mine) == 2
    assert summary["policies"]["prosocial_greedy"]["regret"] == pytest.approx(
        sum(mine) / 2, abs=1e-5
    )


def check_lambda_sweep(tables, summary):
    assert {row["updates"] for row in tables["checkpoints"]} == {10, 20}
    last = [row for row in tables["checkpoints"] if row["updates"] == 20]
    for row, final in zip(last, tables["final"], strict=True):
        assert row.items() <= final.items() and final["regret"] >= -1e-6
    for row in tables["adaptation"]:
        assert row["within_at_end"] == (row["settled_update"] != "")
    assert summary["seeds"] == 2


def check_alternatives(tables, summary):
    assert len(tables["policies"]) == 5 * 3 * 2  # integrations, angles, action selections
    for row in tables["policies"]:
        place = summary[row["integration"]][row["readout"]][f"{row['target_angle']:g}"]
        assert place["1"]["regret"] == row["regret"] >= -1e-6  # one seed


def check_penalties(tables, summary):
    assert len(tables["policies"]) == 3 * 3 * 2  # penalties, angles, action selections
    gaps = {(row["penalty"], row["target_angle"]): row for row in tables["deviations"]}
    assert len(gaps) == 9
    for row in gaps.values():
        assert 0 <= row["matched"] <= 1
        assert row["median"] <= row["largest"] and row["mean"] <= row["largest"]
    for name in ("quadratic", "l1", "kl"):
        mean = sum(gaps[name, angle]["median"] for angle in (0.0, 45.0, 90.0)) / 3
        assert summary[name]["1"]["deviation"]["median"] == pytest.approx(mean, abs=1e-5)


def check_theory(tables, _summary):
    for row in tables["rewards"]:
        assert row["solved"] == pytest.approx(row["closed"], abs=1e-5)
    assert all(row["log10_from_baseline"] > -9 for row in tables["zero"])
    assert {row["seed"] for row in tables["first_flips"]} == {0}


def check_dial(tables, _summary):
    for row in tables["dials"]:
        assert row["worst_regret"] >= row["mean_regret"] >= -1e-6
        assert row["above_ceiling"] == pytest.approx(row["key_regret"] - row["ceiling"], abs=1e-5)
    assert all(row["share_of_radius"] <= 1 + 1e-6 for row in tables["settings"])


def check_off_policy(tables, summary):
    assert len(tables["estimates"]) == 2 * 2 * 3  # shares of random actions, angles, estimators
    for row in tables["estimates"]:
        inside = row["low"] != "" and row["low"] - 1e-5 <= row["exact"] <= row["high"] + 1e-5
        assert row["covers"] == inside
    # the world is deterministic, and the demonstrators show all that the policies do
    whole = summary["pooled"]["crossing5"]["0"]["fitted Q"]
    assert (whole["supported"], whole["error_supported"]) == (1, pytest.approx(0, abs=1e-5))


def check_audits(tables, summary):
    for row in tables["audits"]:
        assert row["regret_low"] <= row["regret"] <= row["regret_high"]
        assert bool(row["decided_by"]) == (row["verdict"] != "pass")
    counts = summary["counts"]
    for kind, truthful in (("truthful", 1), ("false", 0)):
        made = [r for r in tables["audits"] if r["made_for"] != "" and r["truthful"] == truthful]
        assert counts[kind]["audits"] == len(made) > 0
        assert counts[kind]["pass"] == sum(row["verdict"] == "pass" for row in made)


def check_audit_power(tables, _summary):
    for row in tables["verdicts"]:
        assert row["passed"] + row["failed"] + row["inconclusive"] == pytest.approx(1, abs=1e-5)
    assert all(row["low"] <= row["covered"] <= row["high"] for row in tables["coverage"])


def check_own_data(tables, _summary):
    """Random actions have the share 0, the best demonstrator 1, and means are those of the sets."""
    shares = tables["shares"]
    for row in shares:
        assert row["least"] <= row["share"] <= row["most"]
    assert {row["share"] for row in matching(shares, method="random")} == {0.0}
    assert {row["share"] for row in matching(shares, method="best demonstrator")} == {1.0}
    cloned = {row["set"]: row["share"] for row in matching(shares, method="weighted cloning")}
    sets = [share for name, share in cloned.items() if name != "mean"]
    assert cloned["mean"] == pytest.approx(sum(sets) / len(sets), abs=1e-5)
    values = matching(tables["policies"], set="cliff", method="weighted cloning")
    assert [row["angle"] for row in values] == [0.0, 90.0]


def check_audit_tests(tables, summary):
    assert len(tables["tests"]) == 5 * 7 * 3  # tests, shapes, positions
    for row in tables["tests"]:
        assert row["passed"] + row["failed"] <= 1.0
        kept = summary["tests"][row["test"]][f"{row['shape']}, {row['position']}"]
        assert kept == {"passed": row["passed"], "failed": row["failed"]}
    assert all(row["found_low"] <= row["found"] <= row["found_high"] for row in tables["orders"])
    assert all(0.0 <= row["named"] <= 1.0 for row in tables["switching"])


def test_what_must_hold_of_its_tables(study):
    found, results = study
    check = globals()[f"check_{found.name.replace('-', '_')}"]
    check(results.tables, results.summary)


def test_the_other_studies_have_results():
    found = {name for name in STUDIES if (packaged_results() / name).is_dir()}
    assert found == {*STUDIES}


@pytest.mark.parametrize("name", STUDIES)
def test_the_packaged_results_are_shown_by_every_study(name, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", name, "--from", "results"]) == 0
    lines = capsys.readouterr().out.splitlines()
    found = find(name)
    assert found.name == name
    views = found.view(store.load(packaged_results() / name))
    assert len(lines) >= sum(len(view.rows) for view in views) > 0
    for view in views:
        assert not view.title or view.title in lines
        numbers = [v for row in view.rows for v in row.values() if isinstance(v, float)]
        assert all(map(math.isfinite, numbers))


def test_a_study_is_imported_when_it_is_asked_for():
    code = (
        "import sys; from socialiq_lab.registry import find; find('poc');"
        "print(*(m for m in sys.modules if m.startswith('studies.')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {name.split(".")[1] for name in done.stdout.split()} == {"poc"}


def test_an_unknown_study_and_code_that_may_not_run_are_refused(tmp_path):
    with pytest.raises(UserError, match="choose one of alternatives, audit-angles"):
        find("fig7")
    with pytest.raises(UserError, match=r"roads has retired: docs/studies/history.md"):
        find("roads")
    file = tmp_path / "mine.py"
    file.write_text("OTHER = 1")
    with pytest.raises(UserError, match="allow that with --allow-code"):
        find(f"{file}:STUDY")
    for attribute in ("STUDY", "OTHER"):
        with pytest.raises(UserError, match=f"has no study {attribute}"):
            find(f"{file}:{attribute}", allow_code=True)
    broken = tmp_path / "broken.py"
    broken.write_text("1 / 0")
    with pytest.raises(UserError, match="ZeroDivisionError"):
        find(f"{broken}:STUDY", allow_code=True)


@pytest.mark.parametrize(
    ("near", "settled"),
    [
        ([True, True, True], 10),
        ([False, True, True], 20),
        ([True, False, True], 30),
        ([True, True, False], ""),
        ([False, False, False], ""),
    ],
)
def test_a_run_settles_where_it_stays(near, settled):
    from studies.lambda_sweep.study import settled as first_settled

    assert first_settled([10, 20, 30], near) == settled
