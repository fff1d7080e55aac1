"""`unlikeness` and `--fallback`: who decides, which share, and what is refused."""

import json
from pathlib import Path

import jax
import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.evaluation.simulate import Watched, play
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.worlds.intersection.world import Intersection

ROAD = ["--world", "intersection", "--episodes", "6"]


@pytest.fixture(scope="module", name="scored")
def scored_file(tmp_path_factory):
    out = tmp_path_factory.mktemp("scored") / "driver.safetensors"
    assert main(["unlikeness", "prosocial", "--episodes", "20", "--out", str(out)]) == 0
    return str(out)


def result(words, capsys):
    assert main([*words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_file_drives_as_before_and_says_how_it_was_scored(scored, capsys):
    policy = QPolicy.load(scored)
    assert policy.unlikeness is not None
    assert policy.provenance["unlikeness"]["episodes"] == 20
    scores = [result(["evaluate", name, *ROAD], capsys)["r_env"] for name in (scored, "prosocial")]
    assert scores[0] == scores[1]


def test_a_fallback_decides_where_the_alarm_is_raised(scored, capsys):
    """It has more to decide where noise is of 60 m; both commands say the share."""
    own, noisy = (
        result(["evaluate", scored, *ROAD, "--fallback", "wait=0.1", *more], capsys)
        for more in ([], ["--shift", "noise=60"])
    )
    assert own["fallback"] < 0.2 < noisy["fallback"] < 1.0
    words = ["effects", "intersection", "--policy", scored, "--episodes", "2"]
    drivers = result([*words, "--fallback", "wait=0.5"], capsys)["drivers"]
    assert 0.0 < drivers[0]["fallback"] < 1.0


def test_the_share_is_of_running_episodes_alone():
    world, policy = Intersection(), Intersection().driver("go")
    watched = Watched(policy, lambda rows: np.ones(len(rows), bool), world.driver("wait"))
    steps = list(play(world.batch(4), watched, range(6)))
    assert watched.share == 1.0
    assert sum(map(len, watched.kept)) == sum(step.running.sum() for step in steps)
    assert all((step.action == 0).all() for step in steps)  # slower, always


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["prosocial", *ROAD, "--fallback", "wait"], "no score of unlikeness"),
        (["wait", *ROAD, "--fallback", "wait"], "wait is not one network"),
        (["{scored}", *ROAD, "--fallback", "frog"], "unknown driver 'frog'"),
        (["{scored}", *ROAD, "--fallback", "wait=x"], "give a rate as wait=0.05"),
        (["{scored}", *ROAD, "--fallback", "wait=0.9"], "from 0.001 to 0.5"),
        (["{scored}", *ROAD, "--fallback", "wait", "--soft"], "goes without --soft"),
        (["{scored}", "--world", "crossing7", "--fallback", "wait"], "takes 70 features"),
    ],
)
def test_mistakes_are_one_line(words, said, scored, capsys):
    assert main(["evaluate", *(word.format(scored=scored) for word in words)]) == 2
    line = capsys.readouterr().err
    assert said in line and line.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["gap_3s"], "gap_3s is not one network"),
        (["prosocial", "--episodes", "1"], "give 2 or more"),
        (["prosocial", "--world", "mars"], "unknown world"),
        (["nowhere.safetensors"], "nowhere.safetensors"),
    ],
)
def test_what_has_no_score_is_one_line(words, said, capsys, tmp_path):
    assert main(["unlikeness", *words, "--out", str(tmp_path / "new.safetensors")]) == 2
    line = capsys.readouterr().err
    assert said in line and line.count("\n") == 1 and not list(tmp_path.iterdir())


def test_shift_front_end_and_fallback_at_the_merge(tmp_path, capsys):
    """A scored network hands over to another one behind sensors with noise, in both commands."""
    plain, scored, brake = (str(tmp_path / f"{name}.safetensors") for name in ("a", "b", "c"))
    for seed, path in enumerate((plain, brake)):
        network = QNetwork.initialise(jax.random.key(seed), 36, (8,), 5)
        QPolicy.of(network, 1.0, {}).save(Path(path))
    words = ["--world", "merge", "--episodes", "4", "--seed", "5"]
    assert main(["unlikeness", plain, *words, "--out", scored]) == 0
    capsys.readouterr()
    own = result(["evaluate", plain, *words], capsys)
    late = result(["evaluate", plain, *words, "--shift", "late"], capsys)
    assert late["r_env"] != own["r_env"] and "fallback" not in late
    sensed = ["--shift", "noise=60", "--front-end", "known", "--fallback", f"{brake}=0.5"]
    noisy = result(["evaluate", scored, *words, *sensed], capsys)
    assert 0.0 < noisy["fallback"] < 1.0 and noisy["r_env"] != own["r_env"]
    effects = ["effects", "merge", "--policy", scored, "--episodes", "4", "--seed", "5"]
    drivers = result([*effects, *sensed], capsys)["drivers"]
    assert drivers[0]["fallback"] == pytest.approx(noisy["fallback"])
    assert drivers[0]["r_env"] == pytest.approx(noisy["r_env"])


def test_a_policy_of_another_road_is_no_fallback(scored, capsys):
    assert main(["effects", "merge", "--policy", scored, "--fallback", "wait"]) == 2
    assert "takes 70 features" in capsys.readouterr().err


def test_a_fallback_decides_in_a_gridworld(tmp_path, capsys):
    plain, scored, instead = (str(tmp_path / f"{name}.safetensors") for name in ("a", "b", "c"))
    for seed, length, path in ((0, 7, plain), (1, 7, instead)):
        network = QNetwork.initialise(jax.random.key(seed), length, (8,), 3)
        QPolicy.of(network, 1.0, {}).save(Path(path))
    grid = ["--world", "crossing7"]
    assert main(["unlikeness", plain, *grid, "--episodes", "50", "--out", scored]) == 0
    capsys.readouterr()
    own = result(["evaluate", scored, *grid], capsys)
    both = result(["evaluate", scored, *grid, "--fallback", f"{instead}=0.5"], capsys)
    assert both["r_env"] != own["r_env"]
    effects = ["effects", "crossing7", "--policy", scored, "--fallback", f"{instead}=0.5"]
    assert result(effects, capsys)["drivers"][0]["r_env"] == pytest.approx(both["r_env"])


def test_a_fallback_may_observe_the_time_where_the_policy_does_not():
    world = Intersection()
    dial = QPolicy.of(QNetwork.initialise(jax.random.key(0), 71, (8,), 3), 1.0, {})
    own = QPolicy.of(QNetwork.initialise(jax.random.key(1), 70, (8,), 3), 1.0, {})
    lengths = []

    def note(rows):
        lengths.append(rows.shape[1])
        return np.arange(len(rows)) == 0

    watched = Watched(own, note, dial)
    batch = world.batch(2)
    batch.reset([0, 1])
    rows = batch.seen_by(watched)
    assert rows.shape == (2, 71)
    expected = [dial.predict(rows)[0][0], own.predict(rows[:, :70])[0][1]]
    assert watched.predict(rows)[0].tolist() == expected
    assert lengths == [70]
