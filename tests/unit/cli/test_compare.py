"""`socialiq reproduce compare-priors`: what it prints and writes, and what it refuses."""

import json

import jaxtyping
import pytest

from socialiq import results_folder as store
from socialiq.cli.main import main

SMALL = "angles=0,90 development_angles=0 strengths=1 development_seeds=0 updates=5"


@pytest.fixture(name="folder", scope="module")
def compared(tmp_path_factory):
    """A comparison of clones in the 5x5 world."""
    out = tmp_path_factory.mktemp("compare") / "found"
    call = ["reproduce", "compare-priors", "--set", "worlds=crossing5", "methods=clone,cql"]
    assert main([*call, *SMALL.split(), "--seeds", "20", "--out", str(out)]) == 0
    return out


@pytest.mark.slow
def test_a_folder_of_results_is_written(folder):
    results = store.load(folder)
    assert results.study == "compare-priors"
    assert results.config["seeds"] == [20]
    assert {row["method"] for row in results.tables["pooled"]} == {"clone", "cql"}
    assert (folder / "crossing5.png").read_bytes().startswith(b"\x89PNG")
    assert (folder.with_name("found.work") / "priors" / "crossing5" / "fresh").is_dir()


@pytest.mark.slow
def test_results_are_shown_again(folder, capsys):
    assert main(["reproduce", "compare-priors", "--from", str(folder)]) == 0
    shown = capsys.readouterr().out
    assert "crossing5, greedy: regret at the target angle" in shown
    assert "BC, pooled" in shown and "90°" in shown


@pytest.mark.slow
def test_results_as_json(folder, capsys):
    assert main(["reproduce", "compare-priors", "--from", str(folder), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["study"] == "compare-priors"
    assert found["crossing5"]["clone"]["greedy"]["90"]["regret"] >= 0


@pytest.mark.parametrize(
    ("arguments", "mend"),
    [
        (["compare-learners"], "unknown study"),
        (["compare-methods", "--set", "methods=gale"], "choose one of clone, clone_of_mode"),
        (
            ["compare-methods", "--seeds", "100"],
            "a seed of development can't be a seed of the table",
        ),
        (
            ["compare-priors", "--set", "worlds=crossing9"],
            "choose one of crossing5, crossing7",
        ),
        (["compare-priors", "--set", "methods=gail"], "choose one of none, thesis, running"),
        (["compare-priors", "--seeds", "0"], "a seed of development can't be a seed of the table"),
        (["compare-priors", "--from", "nowhere"], "is not a results folder"),
        (["compare-priors", "--set", "worlds=crossing5", "--out", "file/x"], "file exists already"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(arguments, mend, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    (tmp_path / "file").write_text("")
    assert main(["reproduce", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("socialiq: ") and captured.err.count("\n") == 1
    assert mend in captured.err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.slow
def test_a_folder_of_another_study_is_refused(capsys, tmp_path, folder):
    results = store.load(folder)
    other = store.Results("poc", results.config, results.tables, {}, results.versions)
    store.save(other, tmp_path / "poc", {}, replace=False)
    assert main(["reproduce", "compare-priors", "--from", str(tmp_path / "poc")]) == 2
    assert "holds poc" in capsys.readouterr().err


@pytest.mark.slow
def test_an_existing_folder_is_kept(capsys, folder):
    assert main(["reproduce", "compare-priors", "--out", str(folder)]) == 2
    assert "exists already" in capsys.readouterr().err
