"""`evaluate` in parts: the same row, to the last digit, in however many."""

import json

import pytest

from socialiq.cli.drivers import driver_of
from socialiq.cli.evaluate_parts import episodes_in_parts
from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.evaluation.play import Episodes, episodes_of
from socialiq.experiments.engine import Engine
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options


def silent(_):
    return None


def listed(episodes):
    return [getattr(episodes, name) for name in Episodes._fields]


def as_text(episodes):
    return [str([part.tolist() for part in value]) for value in listed(episodes)[:2]] + [
        str(value.tolist()) if hasattr(value, "tolist") else str(value)
        for value in listed(episodes)[2:]
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "soft"), [("gap_3s", False), ("prosocial", True)])
def test_one_two_and_three_parts_are_the_whole(tmp_path, name, soft):
    seeds = range(7, 30)
    whole = episodes_of(Batch(Options(), len(seeds)), driver_of(name), [*seeds], not soft)
    for parts in (1, 2, 3):
        work = tmp_path / f"{parts}"
        made = episodes_in_parts(name, seeds, soft, Engine(), work, silent, parts)
        assert as_text(made) == as_text(whole)


@pytest.mark.slow
def test_the_command_prints_the_same_row(tmp_path, capsys):
    words = ["evaluate", "idm", "--world", "intersection", "--episodes", "9", "--json"]
    assert main(words) == 0
    whole = json.loads(capsys.readouterr().out)
    assert main([*words, "--processes", "2", "--work", str(tmp_path / "work")]) == 0
    assert json.loads(capsys.readouterr().out) == whole
    assert len([*(tmp_path / "work" / "idm").glob("*/job.json")]) == 2


def test_what_can_not_be_split_is_refused(tmp_path, capsys):
    with pytest.raises(UserError, match=r"^random draws its actions in order"):
        episodes_in_parts("random", range(9), False, Engine(), tmp_path, silent, 2)
    words = ["evaluate", "x.safetensors", "--world", "crossing7"]
    for more, line in (
        (["--processes", "2"], "episodes of crossing7 are not split"),
        (["--work", "w"], "--work is of --processes or --cluster"),
    ):
        assert main([*words, *more]) == 2
        assert line in capsys.readouterr().err
