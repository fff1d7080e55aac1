import dataclasses
import re

import jax
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.behaviour_cloning import GaussianCloning
from socialiq.learners.continuous import config
from socialiq.learners.continuous.iq_learn import ContinuousIQLearn
from socialiq.learners.continuous.train import train
from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.iq_learn.config import IQLearnConfig as DiscreteStaticConfig
from socialiq.learners.iq_learn.config import IQLearnHyperparameters as DiscreteHyperparameters
from socialiq.learners.iq_learn.train import train as train_discrete
from socialiq.learners.state import stack

TINY = {"hidden": (8,), "batch_size": 8, "updates": 20}
SAC = config.SACConfig(**TINY, random_steps=5, replay_capacity=50)
IQ = config.ActorIQLearnConfig(**TINY, random_steps=5, replay_capacity=50)
OFFLINE = dataclasses.replace(IQ, online=False, value_term="value_expert")
TD3 = config.TD3BCConfig(**TINY)
NUMBERS = config.SACHyperparameters(seed=3)
IQ_NUMBERS = config.ActorIQLearnHyperparameters(45.0, seed=3)


def learner_of(static, drives, line=None):
    table = ExpertTable.of([drives], "instantaneous", 1.0, continuous=True)
    return ContinuousIQLearn(static, (drives.observation.shape[1], 1), table, line)


def sound(static, numbers, *given, **named):
    trained = train(static, [numbers], *given, **named, chunk=10)
    assert trained.failures == ()
    return trained


@pytest.mark.slow
def test_runs_in_one_program_are_those_of_one_by_one(line):
    runs = [NUMBERS, dataclasses.replace(NUMBERS, seed=4, angle=90.0)]
    both = train(SAC, runs, simulator=line, chunk=10)
    alone = train(SAC, runs[1:], simulator=line, chunk=10)
    seen = np.linspace(-1, 1, 5)[:, None]
    assert both.failures == ()
    np.testing.assert_allclose(
        both.policy(1).predict(seen)[0], alone.policy(0).predict(seen)[0], atol=1e-4
    )
    assert not np.allclose(both.policy(0).predict(seen)[0], both.policy(1).predict(seen)[0])


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits(line, drives, assert_same):
    once, again = (sound(IQ, IQ_NUMBERS, [drives], line) for _ in range(2))
    assert_same(once.networks, again.networks)
    names = {"expert", "value", "chi2", "prior", "actor", "entropy", "loss", "max_q"}
    assert names | {"expert_reward"} == set(once.history.values)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"divergence": "js", "prior": "bellman_shift"}, marks=pytest.mark.slow),
        pytest.param(
            {"value_term": "v0", "prior": "none", "next_value": "online"}, marks=pytest.mark.slow
        ),
        pytest.param(
            {"prior": "shifted_chi2", "dial": True, "actions_per_state": 2}, marks=pytest.mark.slow
        ),
        pytest.param({"prior": "reweighting", "tuned": True}, marks=pytest.mark.slow),
    ],
)
def test_offline_variants_train_soundly(changes, drives):
    static = dataclasses.replace(OFFLINE, **changes)
    numbers = dataclasses.replace(IQ_NUMBERS, angle=0.0)
    trained = sound(static, numbers, [drives])
    policy = trained.policy(0)
    policy = policy.at(30.0) if static.dial else policy
    assert np.abs(policy.predict(np.zeros((4, 1)))[0]).max() <= 1.0
    moved = float(trained.networks.log_temperature[0]) - np.log(0.1)
    assert (abs(moved) > 1e-6) == static.tuned


@pytest.mark.slow
def test_endings_by_occupancy_and_bounded_values_train_soundly(line, drives):
    static = dataclasses.replace(
        IQ,
        prior="none",
        chi2_on="mixture",
        bounded=True,
        endings=Endings("occupancy", "occupancy", "bootstrap", "occupancy"),
    )
    sound(static, config.ActorIQLearnHyperparameters(), [drives], line)


def test_a_dial_without_demonstrations_is_soft_actor_critic_at_all_angles(line):
    dial = sound(dataclasses.replace(SAC, dial=True), NUMBERS, simulator=line).policy(0)
    seen = np.zeros((1, 1))
    assert not np.allclose(dial.at(0.0).predict(seen)[0], dial.at(90.0).predict(seen)[0])


def test_the_actor_alone_learns_at_its_share_of_the_rate(line, drives, assert_same):
    learner = learner_of(IQ, drives, line)

    @jax.jit
    def first_step(one):
        state, carry = learner.initialise(one)
        return state.network, learner.update(one, state, carry)[0].network

    def step(**numbers):
        return first_step(stack([dataclasses.replace(IQ_NUMBERS, **numbers)])[0])

    before, whole = step()
    _, slow = step(actor_rate=0.25)
    assert_same(whole.critics, slow.critics)
    assert_same(whole, step(actor_rate=1.0)[1])
    for old, fast, new in zip(
        *map(jax.tree.leaves, (before.actor, whole.actor, slow.actor)), strict=True
    ):
        np.testing.assert_allclose(new - old, 0.25 * (fast - old), atol=1e-6)
        assert np.abs(fast - old).max() > 1e-4


def test_td3_bc_is_deterministic(drives):
    policy = sound(TD3, config.TD3BCHyperparameters(), [drives]).policy(0)
    assert not policy.is_stochastic


def test_a_prior_and_the_quadratic_term_are_one_shifted_quadratic(drives):
    """c r̂² + w (r̂ - λR)² = κ (r̂ - w λ R / κ)² + constant: the critics' gradients are equal."""
    numbers = {"temperature": 0.3, "seed": 0}
    apart = config.ActorIQLearnHyperparameters(30.0, 2.0, prior_weight=1.5, **numbers)
    kappa = 0.5 + 1.5
    merged = config.ActorIQLearnHyperparameters(
        30.0, 2.0 * 1.5 / kappa, prior_weight=kappa / 0.5, **numbers
    )

    def gradient(prior, run):
        static = dataclasses.replace(OFFLINE, prior=prior)
        learner = learner_of(static, drives)
        one = stack([run])[0]

        @jax.jit
        def slope(one):
            state, carry = learner.initialise(one)
            rows, _ = learner.draw(one, state, carry)
            loss = jax.grad(learner.loss, has_aux=True)
            return loss(state.network, state.target_network, rows, one)[0].critics

        return jax.tree.leaves(slope(one))

    for one, other in zip(gradient("reward", apart), gradient("shifted_chi2", merged), strict=True):
        np.testing.assert_allclose(one, other, atol=2e-5)


def test_weighted_clones_follow_their_angle(random_drives):
    data = random_drives(episodes=40)
    static = GaussianCloning.StaticConfig(hidden=(16,), batch_size=64, updates=150, weighted=True)
    runs = [
        GaussianCloning.Hyperparameters(angle=angle, reweight_temperature=3.0, learning_rate=1e-2)
        for angle in (0.0, 90.0)
    ]
    trained = GaussianCloning.train_on(static, runs, [data])
    ego, others = (trained.policy(run).predict(np.full((1, 1), 0.5))[0][0, 0] for run in (0, 1))
    assert ego > others  # towards 1, and towards 0


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda line, data: train(SAC, [NUMBERS], [data], line), "leave them out"),
        (lambda line, data: train(SAC, [NUMBERS]), "needs a world"),
        (lambda line, data: train(SAC, [], simulator=line), "no runs"),
        (lambda line, data: train(TD3, [config.TD3BCHyperparameters()]), "no demonstr"),
        (
            lambda line, data: train(TD3, [config.TD3BCHyperparameters(dataset=1)], [data]),
            "beyond the 1 given",
        ),
        (
            lambda line, data: train(OFFLINE, [IQ_NUMBERS], [data], line),
            "takes no world",
        ),
        (
            lambda line, data: train(
                dataclasses.replace(OFFLINE, dial=True),
                [IQ_NUMBERS],
                [data],
            ),
            "leave out --angle",
        ),
        (
            lambda line, data: train(IQ, [IQ_NUMBERS], [data], line, sizes=(3, 1)),
            "belong to another world",
        ),
        (
            lambda line, data: train_discrete(
                DiscreteStaticConfig(online=False, value_term="value_expert"),
                [DiscreteHyperparameters()],
                [data],
            ),
            "this learner takes discrete actions",
        ),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(call, says, line, drives):
    with pytest.raises(UserError, match=re.escape(says)):
        call(line, drives)


def test_demonstrations_of_discrete_actions_are_refused(demonstrations):
    with pytest.raises(UserError, match="the demonstrations have discrete actions"):
        train(TD3, [config.TD3BCHyperparameters()], [demonstrations()])
    with pytest.raises(UserError, match="the demonstrations have discrete ones"):
        GaussianCloning.of(GaussianCloning.StaticConfig(), [demonstrations()])


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: config.SACConfig(low=90.0, high=0.0), "give the smaller first"),
        (lambda: config.SACConfig(actions_per_state=0), "actions_per_state"),
        (lambda: config.SACConfig(view="set", input_scale=0.1), "is of --set view=flat"),
        (lambda: config.TD3BCConfig(tuned=True), "no temperature to tune"),
        (lambda: config.ActorIQLearnConfig(form="dueling"), "--set form=dueling is of discrete"),
        (lambda: config.ActorIQLearnConfig(dial=True, prior="none"), "no angle of a row"),
        (lambda: config.SACHyperparameters(entropy_target=np.nan), "entropy_target"),
        (lambda: config.ActorIQLearnHyperparameters(entropy_target=np.inf), "entropy_target"),
        (lambda: config.TD3BCHyperparameters(q_weight=-1.0), "q_weight"),
        (lambda: config.TD3BCHyperparameters(actor_rate=0.0), "actor_rate"),
        (lambda: config.ActorIQLearnHyperparameters(actor_rate=np.nan), "actor_rate"),
    ],
)
def test_settings_that_make_no_run_are_refused(make, says):
    with pytest.raises(UserError, match=says):
        make()


def test_a_view_that_does_not_fit_the_world_is_refused(line):
    static = config.SACConfig(view="set")
    with pytest.raises(UserError, match="use the view flat"):
        train(static, [config.SACHyperparameters()], simulator=line)
