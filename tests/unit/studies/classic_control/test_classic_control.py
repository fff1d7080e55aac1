"""Parts of the study: the compiled CartPole, experts, protocols and linear fits."""

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import read_json
from socialiq.types import Ending
from socialiq_lab.registry import declaration, find
from studies.classic_control import runs, study
from studies.classic_control.runs import METHODS, RECIPES, VARIANTS
from studies.classic_control.study import jobs, plan, sources_of
from studies.classic_control.tasks import STEPS, TASKS, CartPole, Episode, returns

Config = find("classic-control").Config
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
        jobs(Config(protocols=("every",)))


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


def row(method: str, number: int, seed: str, value: float) -> dict:
    label = {"task": "CartPole", "protocol": "rows", "trajectories": 1, "method": method}
    return label | {"set": number, "rows": 25, "seed": seed, "mean_return": value}


POLICIES = [
    row(method, number, seed, value + shift)
    for method, shift in (("iq_learn", 100.0), ("cloning", 0.0))
    for number, values in enumerate(((100.0, 300.0, 200.0), (380.0, 420.0, 400.0)))
    for seed, value in zip(("10", "11", "ensemble"), values, strict=True)
]


def test_policies_are_pooled_over_sets_and_seeds_without_the_ensembles() -> None:
    keys = ("task", "method")
    learned, cloned = study.pooled(POLICIES, *keys)
    assert (learned["mean"], cloned["mean"], cloned["policies"]) == (400.0, 300.0, 4)
    assert (cloned["worst"], cloned["best"]) == (100.0, 420.0)
    assert learned["solved"] == 0.5  # of 200, 400, 480, 520 two are at least 475
    assert (cloned["ensemble_mean"], cloned["ensemble_worst"]) == (300.0, 200.0)
    # Means of the sets are 200 and 400.
    assert cloned["deviation_of_sets"] == pytest.approx(np.sqrt(2) * 100)


def test_methods_are_compared_over_sets() -> None:
    """Both sets' means differ by 100: the mean of two seeds each, never an ensemble's."""
    (test,) = study.differences(POLICIES)
    assert (test["first"], test["second"], test["mean"]) == ("iq_learn", "cloning", 100.0)
    alone = [entry for entry in POLICIES if entry["set"] == 0]
    assert study.differences(alone) == []


def test_sources_of_a_task() -> None:
    config = Config(trajectories=(1, 5), protocol_trajectories=(5,), other_trajectories=(3,))
    kinds = {
        task: [(one.protocol, one.trajectories, one.sets) for one in sources_of(config, task)]
        for task in TASKS
    }
    assert kinds["CartPole"] == [
        ("rows", 1, 12), ("rows", 5, 12), ("stride", 5, 12), ("whole", 5, 12),
    ]  # fmt: skip
    assert kinds["CartPole, drifting expert"] == [("rows", 1, 12)]
    assert kinds["Acrobot"] == kinds["LunarLander"] == [("rows", 3, 6)]


def test_sets_are_of_trajectories_of_their_own() -> None:
    source = runs.Source("Acrobot", "stride", 1, 2, 50_000_000, 1, 0)
    first, second = source.whole_trajectories()
    assert first.n_episodes == second.n_episodes == 1
    assert not np.array_equal(first.observation[0], second.observation[0])
    strides = source.thinned([first, second], False)
    assert [len(data.action) for data in strides] == [
        -(-len(data.action) // TASKS["Acrobot"].every) for data in (first, second)
    ]


def test_a_run_has_a_row_for_each_policy_and_one_for_their_ensemble(monkeypatch, tmp_path) -> None:
    """Two sets and two seeds; each policy pushes to its own side, and the ensemble by the mean."""

    def taking(values) -> QPolicy:
        drawn = QNetwork.initialise(jax.random.key(0), 4, (), 2)
        leaves = [jnp.zeros((2, 4)), jnp.array(values)]
        return QPolicy.of(jax.tree.unflatten(jax.tree.structure(drawn), leaves), 1.0, {})

    sides = [taking(values) for values in ([0.0, 1.0], [10.0, 7.0], [0.0, 1.0], [10.0, 9.5])]
    trained = type("Trained", (), {"policy": lambda _self, run: sides[run]})()
    monkeypatch.setattr(runs, "learn", lambda *_inputs: trained)
    monkeypatch.setattr(runs.Source, "score", lambda _self, act: float(act(np.zeros((1, 4)))[0]))
    source = runs.Source("CartPole", "rows", 1, 2, 50_000_000, 1, 0)
    training = runs.Training(source, "cloning", (5, 6), 1)
    runs.train_and_score(training, tmp_path, {}, lambda _share: None)
    rows = read_json(tmp_path / runs.ROWS)
    assert [(one["set"], one["seed"]) for one in rows] == [
        (number, seed) for number in (0, 1) for seed in ("5", "6", "ensemble")
    ]
    # Advantages ±0.5 of the first, ±1.5 and ±0.25 of the second: the ensembles take 0, then 1.
    assert [one["mean_return"] for one in rows] == [1.0, 0.0, 0.0, 1.0, 0.0, 1.0]
