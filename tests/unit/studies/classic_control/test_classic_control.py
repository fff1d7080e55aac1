"""Parts of the study: the compiled CartPole, experts, protocols and linear fits."""

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq_lab.registry import declaration
from studies.classic_control import runs
from studies.classic_control.runs import METHODS, RECIPES, VARIANTS
from studies.classic_control.study import Config, plan
from studies.classic_control.tasks import STEPS, TASKS, CartPole, Episode, returns

CARTPOLE = TASKS["CartPole"]
WITHOUT_EXTRA = [name for name in TASKS if name != "LunarLander"]


@pytest.fixture(name="shown", scope="module")
def expert_trajectory():
    return runs.trajectories(CARTPOLE, 1, 50_000_000)


def test_the_compiled_cartpole_moves_as_gymnasiums() -> None:
    """Under random actions until it falls, from the same states, over five episodes."""
    env, world = gymnasium.make("CartPole-v1"), CartPole()
    advance = jax.jit(world.advance)
    rng = np.random.default_rng(0)
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        episode = Episode(jnp.asarray(observation), jnp.zeros((), jnp.int32))
        ended = False
        while not ended:
            action = int(rng.integers(2))
            expected, reward, ended, _, _ = env.step(action)
            episode, step = advance(None, episode, jnp.asarray(action))
            np.testing.assert_allclose(step.observation, expected, atol=2e-5)
            assert (step.rewards.env, step.rewards.social) == (reward, 0.0)
            assert int(step.ending) == (Ending.OTHER if ended else Ending.NONE)


def test_the_compiled_cartpole_stops_at_the_clock() -> None:
    episode = Episode(jnp.zeros(4), jnp.asarray(STEPS - 1))
    _, step = CartPole().advance(None, episode, jnp.asarray(1))
    assert int(step.ending) == Ending.TIMEOUT


@pytest.mark.parametrize("name", WITHOUT_EXTRA)
def test_a_task_looks_the_same_in_the_mirror(name: str) -> None:
    """The image of a step is the step of the image, from the environment's own state."""
    task = TASKS[name]
    env = gymnasium.make(task.env).unwrapped
    observation, _ = env.reset(seed=1)
    flipped = -np.asarray(env.state)
    for action in range(len(task.symmetry.actions)):
        env.state = -flipped
        after = env.step(action)[0]
        env.reset(seed=1)
        env.state = flipped
        mirrored = env.step(task.symmetry.actions[action])[0]
        np.testing.assert_allclose(mirrored, task.symmetry.image(after[None])[0], atol=1e-5)
    assert len(task.symmetry.signs) == len(observation)


@pytest.mark.parametrize(
    ("name", "least"), [("CartPole", 500), ("CartPole, drifting expert", 500), ("Acrobot", -130)]
)
def test_experts_are_experts(name: str, least: float) -> None:
    task = TASKS[name]
    assert returns(task, task.expert.act, 4, 60_000_000).mean() >= least


def test_an_expert_answers_one_observation_as_it_answers_a_batch() -> None:
    seen = np.random.default_rng(0).normal(size=(5, 4))
    batch = CARTPOLE.expert.predict(seen)[0]
    assert [int(CARTPOLE.expert.predict(one)[0]) for one in seen] == batch.tolist()


def test_the_stride_beats_with_the_experts_cycle(shown) -> None:
    """At a stride of 20 the fast features hardly vary; one row of each block keeps their spread."""
    rows, stride = (runs.thinned(shown, one, CARTPOLE, 0, False) for one in ("rows", "stride"))
    assert rows.n_transitions == stride.n_transitions == 25
    assert runs.spread_kept(stride, shown) < 0.2 < 0.5 < runs.spread_kept(rows, shown)
    assert runs.spread_kept(shown, shown) == pytest.approx(1.0)


def test_the_cycle_of_a_periodic_demonstrator(shown) -> None:
    periodic = np.arange(shown.n_transitions, dtype=np.int32) // 3 % 2
    one = runs.Demonstrations.of(
        observation=shown.observation,
        action=periodic,
        next_observation=shown.next_observation,
        ending=shown.ending,
        rewards=shown.rewards,
        episode=shown.episode,
        n_actions=2,
    )
    assert runs.cycle(one) == (6, 1.0)


def test_a_linear_fit_of_whole_trajectories_recovers_the_expert(shown) -> None:
    weights = runs.linear_fit(shown, 1e-4)
    expected = np.array([0.05, 0.1, 1.0, 0.3])
    cosine = weights @ expected / np.linalg.norm(weights) / np.linalg.norm(expected)
    assert cosine > 0.99


def test_every_variant_changes_its_method_and_nothing_is_unknown() -> None:
    declared = declaration("classic-control")["variant"]
    assert list(declared) == list(VARIANTS)
    for name, changes in declared.items():
        assert RECIPES[name] != METHODS[changes["of"]]
    with pytest.raises(UserError, match="protocol"):
        Config(protocols=("every",))


def test_cloning_has_what_the_offline_preset_has() -> None:
    ours, theirs = METHODS["iq_learn"].static, METHODS["cloning"].static
    for name in ("hidden", "activation", "batch_size", "schedule", "averaging"):
        assert getattr(ours, name) == getattr(theirs, name)
    assert METHODS["iq_learn"].numbers.learning_rate == METHODS["cloning"].numbers.learning_rate


def test_jobs_have_names_of_their_own() -> None:
    names = [job.name for job in plan(Config())]
    assert len(names) > 40
    assert len(set(names)) == len(names)
    fewer = Config(
        tasks=("CartPole", "Acrobot"), protocol_trajectories=(1,), other_trajectories=(5,)
    )
    added = {*names} - {job.name for job in plan(fewer)}
    assert {name.split("/")[1] for name in added} == {
        "CartPole-stride-5",
        "CartPole-whole-5",
        "CartPole__drifting_expert-rows-1",
        "Acrobot-rows-1",
        "LunarLander-rows-1",
        "LunarLander-rows-5",
    }
