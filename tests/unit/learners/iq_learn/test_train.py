import dataclasses
import signal
from typing import Any

import jax
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.callbacks import Callbacks, Report, Stopped
from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.iq_learn.config import Endings, IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.train import IQLearn, train
from socialiq.learners.state import HyperparameterArrays, stack
from socialiq.nn.q_network import network_of
from socialiq.worlds import registry

ONLINE = IQLearnConfig(hidden=(8,), batch_size=8, updates=60, replay_capacity=50)
OFFLINE = dataclasses.replace(ONLINE, online=False, value_term="value_expert")
RUNS = (IQLearnHyperparameters(seed=0, angle=45.0), IQLearnHyperparameters(seed=1, angle=45.0))
CROSSING7 = registry.make_grid("crossing7")


@pytest.fixture(name="whole", scope="module")
def uninterrupted(data):
    return train(ONLINE, RUNS, [data], CROSSING7, chunk=20)


def observations(data) -> np.ndarray:
    return data.observation[:10]


def test_an_online_run_trains_every_run_soundly(whole, data):
    assert whole.failures == ()
    assert whole.history.updates == [20, 40, 60]
    terms = {"expert", "value", "chi2", "prior", "loss", "max_q", "expert_reward"}
    assert set(whole.history.values) == terms
    assert all(np.isfinite(whole.history.array(name)).all() for name in terms)
    parts = [whole.history.array(name) for name in ("expert", "value", "chi2", "prior")]
    np.testing.assert_allclose(np.sum(parts, axis=0), whole.history.array("loss"), rtol=1e-5)


def test_the_same_seed_gives_the_same_bits(whole, assert_same, data):
    again = train(ONLINE, RUNS, [data], CROSSING7, chunk=20)
    assert_same(again.networks, whole.networks)
    assert_same(again.history.values, whole.history.values)


def test_different_seeds_differ(whole, data):
    first, second = (whole.policy(run).q_values(observations(data)) for run in (0, 1))
    assert not np.allclose(first, second)


def test_a_resumed_run_equals_an_uninterrupted_one_bit_for_bit(whole, assert_same, data, tmp_path):
    path = tmp_path / "state"

    def interrupt(report: Report) -> None:
        if report.done == 40:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(Stopped, match="stopped after 40 of 60 updates"):
        train(ONLINE, RUNS, [data], CROSSING7, Callbacks(interrupt, checkpoint=path), chunk=20)
    around = Callbacks(checkpoint=path, resume=True)
    resumed = train(ONLINE, RUNS, [data], CROSSING7, around, chunk=20)
    assert_same(resumed.networks, whole.networks)
    assert resumed.history.updates == whole.history.updates
    for name in whole.history.values:
        np.testing.assert_array_equal(resumed.history.array(name), whole.history.array(name))

    changed = (RUNS[0], dataclasses.replace(RUNS[1], strength=2.0))
    with pytest.raises(UserError, match="belongs to a run of other settings"):
        train(ONLINE, changed, [data], CROSSING7, around, chunk=20)


@pytest.mark.parametrize(
    ("wild", "broken"), [({"learning_rate": 1e30}, "parameters"), ({"strength": 1e30}, "prior")]
)
def test_a_run_that_diverges_stops_and_the_other_trains_on(whole, assert_same, data, wild, broken):
    found = train(
        ONLINE, (RUNS[0], dataclasses.replace(RUNS[1], **wild)), [data], CROSSING7, chunk=20
    )
    assert len(found.failures) == 1
    assert "seed 1 stopped at update 0: " in found.failures[0]
    assert f": {broken} not finite; lower learning_rate" in found.failures[0]
    first = jax.tree.map(lambda leaf: leaf[0], (found.networks, whole.networks))
    assert_same(*first)
    assert np.isfinite(found.policy(1).weights[0]).all()


def test_a_run_does_not_depend_on_its_neighbours(whole, data):
    alone = train(ONLINE, RUNS[1:], [data], CROSSING7, chunk=60)
    found, expected = alone.policy(0), whole.policy(1)
    np.testing.assert_allclose(
        found.q_values(observations(data)), expected.q_values(observations(data)), atol=1e-5
    )


def test_a_policy_carries_its_temperature_and_its_origin(whole):
    policy = whole.policy(1)
    assert policy.temperature == 1.0
    assert policy.provenance["learner"] == "iq_learn"
    assert IQLearnHyperparameters(**policy.provenance["numbers"]) == RUNS[1]
    assert policy.provenance["structure"]["hidden"] == (8,)


def test_the_learner_acts_with_its_soft_policy_and_starts_anew_after_an_end(data):
    """Two runs that never learn: one so hot that it acts evenly, one so cold that it is greedy."""
    steps = 400
    static = dataclasses.replace(ONLINE, batch_size=1, replay_capacity=steps)
    table = ExpertTable.of([data], "running", 0.99)
    hyperparameters = stack(
        [IQLearnHyperparameters(temperature=tau, learning_rate=1e-30) for tau in (1e6, 1e-6)]
    )

    learner = IQLearn(static, (6, 3), table, CROSSING7)

    def live(one: HyperparameterArrays) -> tuple[Any, Any]:
        return jax.lax.scan(
            lambda run, _: (learner.update(one, *run)[:2], None),
            learner.initialise(one),
            length=steps,
        )[0]

    state, carry = jax.jit(jax.vmap(live))(hyperparameters)
    hot, cold = (
        jax.tree.map(lambda column, run=run: np.asarray(column[run]), carry.replay.columns)
        for run in (0, 1)
    )
    np.testing.assert_allclose(np.bincount(hot.action) / steps, [1 / 3] * 3, atol=0.08)
    q = jax.vmap(network_of(state.network, 1))(cold.observation)
    np.testing.assert_array_equal(cold.action, q.argmax(axis=1))
    for rows in (hot, cold):
        ended = rows.ending[:-1] > 0
        assert 0 < ended.sum() < steps / 2
        np.testing.assert_array_equal(
            rows.observation[1:][~ended], rows.next_observation[:-1][~ended]
        )
        starts = [state for state, _ in CROSSING7.start]
        assert {tuple(row) for row in rows.observation[1:][ended].astype(int).tolist()} <= set(
            starts
        )


# Together these runs, ONLINE and OFFLINE have every value of every choice; each has its program.
VARIANTS: dict[str, tuple[dict[str, Any], IQLearnHyperparameters]] = {
    "shifted_chi2": (
        {"prior": "shifted_chi2", "target_kind": "instantaneous", "chi2_on": "mixture"}
        | {"endings": Endings(collision="absorbing", timeout="bootstrap")}
        | {"online": True, "value_term": "value", "env_steps_per_update": 2},
        IQLearnHyperparameters(angle=90.0),
    ),
    "bellman_shift": (
        {"prior": "bellman_shift", "shift_term_3": True, "target_kind": "to_go"}
        | {"value_term": "v0", "next_value": "online"},
        IQLearnHyperparameters(),
    ),
    "kl": (
        {"divergence": "kl", "prior": "none", "value_term": "v0", "activation": "elu"},
        IQLearnHyperparameters(),
    ),
    "reverse_kl": (
        {"divergence": "reverse_kl", "prior": "reweighting", "next_value": "online"},
        IQLearnHyperparameters(reweight_temperature=0.5),
    ),
    "hellinger": ({"divergence": "hellinger", "prior": "bellman_shift"}, IQLearnHyperparameters()),
    "js": ({"divergence": "js", "target_kind": "trajectory"}, IQLearnHyperparameters()),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_every_variant_trains_with_finite_terms(name, data):
    choices, hyperparameters = VARIANTS[name]
    static = dataclasses.replace(OFFLINE, updates=20, **choices)
    still = dataclasses.replace(hyperparameters, learning_rate=1e-30)  # keeps the network it drew
    world = CROSSING7 if static.online else None
    found = train(static, [hyperparameters, still], [data], world, chunk=20)
    assert found.failures == ()
    assert all(np.isfinite(found.history.array(term)).all() for term in found.history.values)
    q, drawn = (found.policy(run).q_values(observations(data)) for run in (0, 1))
    assert np.abs(q - drawn).max() > 1e-3


@pytest.mark.parametrize(
    ("static", "hyperparameters", "world", "words"),
    [
        (ONLINE, [], CROSSING7, "no runs"),
        (ONLINE, RUNS, None, "online training needs a world"),
        (OFFLINE, RUNS, CROSSING7, "offline training takes no world"),
        (ONLINE, [IQLearnHyperparameters(dataset=1)], CROSSING7, "beyond the 1 given"),
        (ONLINE, RUNS, registry.make_grid("crossing5"), "they belong to another world"),
    ],
)
def test_settings_that_do_not_fit_together_are_refused(data, static, hyperparameters, world, words):
    with pytest.raises(UserError, match=words):
        train(static, list(hyperparameters), [data], world)


def test_demonstrations_that_do_not_fit_together_are_refused(data, demonstrations):
    with pytest.raises(UserError, match="no demonstrations"):
        train(OFFLINE, RUNS, [])
    with pytest.raises(UserError, match="different actions"):
        train(OFFLINE, RUNS, [data, demonstrations(n_actions=5)])
    with pytest.raises(UserError, match="offline training takes no world"):
        train(OFFLINE, RUNS, [data], before_chunk=lambda runs, done: runs)
