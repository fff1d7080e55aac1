"""The search of the angle finds drivers that are planted in a gridworld (thesis 8.5)."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from socialiq import UserError, equal_trajectories, score, tabulate, weights
from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.evaluation.angle_search import search
from socialiq.evaluation.rollout import rollout_table
from socialiq.mdp.horizon import horizon_optimum
from socialiq.mdp.solve import soft_policy, value_iteration
from socialiq.worlds.registry import make_grid

PART = tabulate(make_grid("crossing7")).reachable_part()
PLACES = {state.tobytes(): row for row, state in enumerate(PART.states)}


def table_at(angle):
    """Return the soft optimum of R(angle), (state, action)."""
    values = value_iteration(PART.mdp, score(weights(angle), PART.mdp.rewards), 0.99)
    return soft_policy(values.q, 0.2)


def policies_at(angles):
    def policy(angle):
        table = table_at(angle)

        def probabilities(observations):
            return table[[PLACES[row.astype(PART.states.dtype).tobytes()] for row in observations]]

        return SimpleNamespace(probabilities=probabilities)

    return [policy(angle) for angle in angles]


def shown(angles, episodes=60, seed=5):
    """Return episodes of drivers of these angles, in equal numbers."""
    parts = {
        f"at {angle:g}": rollout_table(
            PART, table_at(angle), episodes, seed=seed + number, mode=f"at {angle:g}"
        ).transitions
        for number, angle in enumerate(angles)
    }
    return equal_trajectories(parts, episodes, seed)


@pytest.mark.parametrize("planted", [0.0, 25.0, 45.0, 70.0, 90.0])
def test_the_angle_of_exact_drivers_is_in_the_interval(planted):
    searched = search(policies_at, shown([planted]))
    assert searched.low - 5.0 <= planted <= searched.high + 5.0  # between two angles of the grid
    assert searched.low <= searched.angle <= searched.high <= searched.low + 30.0
    best = max(searched.table, key=lambda row: row["log_likelihood"])
    assert best["angle"] == searched.angle


def test_a_population_has_the_angle_of_its_middle():
    searched = search(policies_at, shown([25.0, 35.0, 45.0, 55.0, 65.0]))
    assert abs(searched.angle - 45.0) <= 15.0


def test_one_episode_has_no_interval():
    with pytest.raises(UserError, match="two or more episodes"):
        search(policies_at, shown([45.0], episodes=1))


@pytest.fixture
def mixed(tmp_path, monkeypatch, capsys):
    """Mixed demonstrations and wanted ones, in the folder of the test."""
    monkeypatch.chdir(tmp_path)
    assert main(["collect", "crossing7", "--episodes", "20", "--out", "mixed.safetensors"]) == 0
    files.save("wanted.safetensors", shown([90.0]))
    capsys.readouterr()
    return [
        "train",
        "iq-learn",
        "mixed.safetensors",
        "--hidden",
        "8",
        "--updates",
        "2",
        "--out",
        "run",
    ]


def test_the_command_trains_at_the_angle_that_it_prints(mixed, capsys):
    words = [*mixed, "--angle-from", "wanted.safetensors", "--seed", "0", "1"]
    assert main(words) == 0
    record = json.loads(Path("run/run.json").read_text())
    angle = record["angle_search"]["angle"]
    assert f"angle of wanted.safetensors: {angle:g} degrees" in capsys.readouterr().err
    assert [row["angle"] for row in record["policies"]] == [angle, angle]
    assert len(record["angle_search"]["table"]) == 19


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--angle", "30"], "leave out --angle"),
        (["--strength", "1", "2"], "one --strength"),
        (["--prior", "none"], "reads no reward"),
    ],
)
def test_options_that_do_not_go_with_a_search(mixed, words, line, capsys):
    assert main([*mixed, "--angle-from", "wanted.safetensors", *words]) == 2
    assert line in capsys.readouterr().err


def test_wanted_behaviour_of_another_world(mixed, capsys):
    assert main(["collect", "crossing5", "--episodes", "2", "--out", "small.safetensors"]) == 0
    assert main([*mixed, "--angle-from", "small.safetensors"]) == 2
    assert "collect both in one world" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("planted", [0.0, 45.0, 90.0])
def test_trained_policies_find_it_too(planted, tmp_path, monkeypatch):
    """Policies that IQ-Learn trained on mixed drivers, and the exact optimum as what is wanted."""
    monkeypatch.chdir(tmp_path)
    assert main(["collect", "crossing7", "--episodes", "60", "--out", "mixed.safetensors"]) == 0
    reward = score(weights(planted), PART.mdp.rewards)
    best = horizon_optimum(PART.mdp, reward, PART.world.horizon).actions[0]
    table = np.eye(PART.mdp.n_actions)[best]
    wanted = rollout_table(PART, table, 20, seed=77, mode="wanted").transitions
    files.save("wanted.safetensors", equal_trajectories({"wanted": wanted}, 20, 77))
    words = "train iq-learn mixed.safetensors --world crossing7 --updates 1500 --out run"
    assert main([*words.split(), "--angle-from", "wanted.safetensors"]) == 0
    angle = json.loads((tmp_path / "run/run.json").read_text())["angle_search"]["angle"]
    assert abs(angle - planted) <= 15.0
