import pytest

import socialiq
from socialiq.worlds.highway import render
from socialiq_lab.cli import commands
from socialiq_lab.cli.demo import DRIVERS, FILMED, Demo


def test_the_last_table_has_the_best_dial_at_three_angles_beside_expert_and_rules(
    tmp_path, monkeypatch
):
    whole = render.episode_scenes
    monkeypatch.setattr(render, "episode_scenes", lambda *episode: whole(*episode)[::8])
    rows = Demo(out=tmp_path, episodes=50).drive()
    assert [row["driver"] for row in rows] == list(DRIVERS)
    by_name = {row["driver"]: row for row in rows}
    assert by_name[FILMED]["collision"] < by_name["go"]["collision"]
    assert by_name["dial at 85 degrees"]["stopped"] > by_name[FILMED]["stopped"]
    assert (tmp_path / "intersection.gif").stat().st_size > 10_000


def test_a_package_in_a_short_path_has_no_benchmarks(monkeypatch):
    monkeypatch.setattr(socialiq, "__file__", "/site/socialiq/__init__.py")
    with pytest.raises(socialiq.UserError, match="in a checkout"):
        commands.load("worlds")
