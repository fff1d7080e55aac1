"""MO-Gymnasium itself: exact fronts against the published ones, a small run of the study."""

from typing import Any

import numpy as np
import pytest

pytest.importorskip("mo_gymnasium", reason="mo-gymnasium is not installed")

from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.evaluation.front import hypervolume
from socialiq.evaluation.rollout import rollout_env
from socialiq.results_folder import load
from socialiq.worlds.environment import make_environment
from studies.mo_gymnasium.tasks import TASKS, enumerated, exact_set, known_front

pytestmark = [
    # Gymnasium warns of rewards that are vectors, and of bounds in float64.
    pytest.mark.filterwarnings("ignore:.*reward returned by:UserWarning"),
    pytest.mark.filterwarnings("ignore:.*precision lowered:UserWarning"),
]


def as_set(points):
    return {tuple(point) for point in np.round(points, 4).tolist()}


def test_the_exact_front_is_the_published_one_but_for_a_point_on_an_edge():
    exact, published = exact_set("deep-sea-treasure").front(), known_front("deep-sea-treasure")
    # (20.3, -14) is on the edge between (19.6, -13) and (22.4, -17): the best at no angle alone.
    assert as_set(published) - as_set(exact) == {(20.3, -14.0)}
    assert as_set(exact) < as_set(published)


def test_of_a_concave_front_angles_reach_the_two_ends_alone():
    exact = exact_set("deep-sea-treasure-concave").front()
    assert as_set(exact) == {(124.0, -19.0), (1.0, -1.0)}
    published = known_front("deep-sea-treasure-concave")
    assert len(published) == 10
    reference = np.array(TASKS["deep-sea-treasure-concave"].reference)
    assert hypervolume(exact, reference) < hypervolume(published, reference)


def test_the_enumerated_world_moves_as_the_environment_does():
    env = TASKS["deep-sea-treasure"].make()
    mdp, rng = enumerated(env), np.random.default_rng(0)
    for seed in range(5):
        env.reset(seed=seed)
        state, ended = 0, False
        while not ended:
            action = int(rng.integers(4))
            _, _, ended, cut, info = env.step(action)
            pair = [mdp.rewards.env[state, action], mdp.rewards.social[state, action]]
            assert info["reward_pair"].tolist() == pytest.approx(pair)
            assert (mdp.ending[state, action, 0] != 0) == ended
            state = int(mdp.successor[state, action, 0])
            if cut:
                break


def test_a_task_of_three_rewards_is_refused_in_one_line():
    name = "mo_gymnasium:mo-mountaincar-v0"
    env = make_environment(name, allow_code=True, needs_pair=True)

    class Still:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.ones(np.shape(observation)[:-1], int), state

    with pytest.raises(
        UserError, match="a vector reward has length 3, and an angle weighs two parts"
    ):
        rollout_env(env, Still(), 1, seed=0)


@pytest.mark.parametrize("name", TASKS)
def test_every_task_has_a_pair_of_rewards_and_a_time_limit(name):
    if name.startswith(("mo-half", "mo-hopper", "mo-swimmer")):
        pytest.importorskip("mujoco", reason="mujoco is not installed")
    env = TASKS[name].make()
    assert TASKS[name].time_limit() in {100, 200, 1000}
    env.reset(seed=100)
    env.action_space.seed(100)
    action = env.action_space.sample()
    info, ended, steps = {}, False, 0
    while not ended:
        _, _, terminated, truncated, info = env.step(action)
        ended, steps = terminated or truncated, steps + 1
    assert np.shape(info["reward_pair"]) == (2,) and np.isfinite(info["reward_pair"]).all()
    assert steps <= TASKS[name].time_limit()


def test_the_reservoir_releases_a_share_of_what_it_may():
    """Without `normalized_action` its actions have no upper bound, and none could be scaled."""
    env = TASKS["water-reservoir"].make()
    env.reset(seed=100)
    inner: Any = env.unwrapped
    level = float(inner.state[0])
    env.step(np.ones(1, np.float32))  # the upper end of [-1, 1]: all of it
    assert inner.last_action == pytest.approx(level)


@pytest.mark.slow
def test_a_small_study_adds_to_what_is_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "none").mkdir()
    call = ["reproduce", "mo-gymnasium", "--set", "tasks=deep-sea-treasure", "steps=1500"]
    call += ["methods=dial"]
    assert main([*call, "pieces=none", "--seeds", "100", "--processes", "1", "--out", "one"]) == 0
    assert len(load(tmp_path / "one").tables["runs"]) == 1
    assert (
        main(
            [
                *call,
                "pieces=one/pieces",
                "--seeds",
                "100",
                "101",
                "--processes",
                "1",
                "--out",
                "two",
            ]
        )
        == 0
    )
    runs = load(tmp_path / "two").tables["runs"]
    assert [row["seed"] for row in runs] == [100, 101]
    assert runs[0] == load(tmp_path / "one").tables["runs"][0]
    assert all(row["mean_loss"] >= 0.0 for row in runs)
