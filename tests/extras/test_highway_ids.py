"""highway-env's own ids name its environments, which give no reward pair."""

import json

import pytest

from socialiq.cli.main import main

pytest.importorskip("highway_env")
pytestmark = pytest.mark.filterwarnings("ignore:.*out of date:DeprecationWarning")
KEEP = "python:keep.py:keep"


@pytest.fixture(autouse=True)
def policy(tmp_path, monkeypatch, as_a_user_runs_it):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "keep.py").write_text("def keep(rows):\n    return [1 for _ in rows]\n")


def test_an_id_of_highway_env_is_a_world(capsys):
    words = ["evaluate", KEEP, "--world", "merge-v0", "--episodes", "1", "--allow-code", "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["r_env"] > 0


@pytest.mark.parametrize("world", ["merge-v0", "intersection-v1", "highway-v0"])
def test_where_a_pair_is_due_roads_that_have_one_are_named(world, tmp_path, capsys):
    words = ["collect", world, "--driver", KEEP, "--out", "run", "--allow-code"]
    assert main(words) == 2
    assert "choose intersection, merge, roundabout, two_way, its" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
