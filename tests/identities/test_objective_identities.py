"""Equations between whole objectives, on random networks and batches (docs: the thesis' 4.3, B)."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners import cql
from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn.config import Endings, IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.objective import Batches, objective
from socialiq.learners.state import HyperparameterArrays, stack
from socialiq.nn.q_network import QNetwork
from socialiq.social.angle import exact_weights
from socialiq.types import RewardPair

SIZE, N_FEATURES, N_ACTIONS = 16, 3, 4
NUMBERS = IQLearnHyperparameters(
    angle=30.0, strength=0.8, prior_weight=0.7, temperature=0.6, discount=0.9
)
EXPERT_ONLY = {"online": False, "value_term": "value_expert"}
C = 1 / (4 * NUMBERS.chi2_alpha)
KAPPA = C + NUMBERS.prior_weight
both_sources = pytest.mark.parametrize("next_value", ["target", "online"])
seeds = pytest.mark.parametrize("seed", range(2))


def static(**choices: Any) -> IQLearnConfig:
    endings = Endings("zero", "absorbing", "bootstrap", "zero")
    return IQLearnConfig(**{"batch_size": SIZE, "endings": endings, **choices})


def hyperparameters(**changes: Any) -> HyperparameterArrays:
    return stack([dataclasses.replace(NUMBERS, **changes)])[0]


def batch(seed: int) -> Batch:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> jax.Array:
        return jnp.asarray(rng.normal(size=shape), jnp.float32)

    return Batch(
        observation=normal(SIZE, N_FEATURES),
        action=jnp.asarray(rng.integers(N_ACTIONS, size=SIZE)),
        next_observation=normal(SIZE, N_FEATURES),
        ending=jnp.asarray(rng.integers(5, size=SIZE)),
        target=RewardPair(2 * normal(SIZE), 2 * normal(SIZE)),
    )


class Problem:
    """A random network with its target network, and random batches."""

    def __init__(self, seed: int) -> None:
        keys = jax.random.split(jax.random.key(seed))
        self.network, self.target_network = (
            QNetwork.initialise(key, N_FEATURES, (9,), N_ACTIONS, "elu") for key in keys
        )
        self.expert, self.replay = batch(seed), batch(seed + 100)
        self.initial = batch(seed + 200).observation

    def batches(self, shape: IQLearnConfig) -> Batches:
        return Batches(
            self.expert,
            self.replay if shape.online else None,
            self.initial if shape.value_term == "v0" else None,
        )

    def terms(self, shape: IQLearnConfig, **changes: Any) -> dict[str, jax.Array]:
        found = objective(
            self.network,
            self.target_network,
            self.batches(shape),
            hyperparameters(**changes),
            shape,
        )
        return found[1]

    def gradient(self, shape: IQLearnConfig, **changes: Any) -> np.ndarray:
        found = jax.grad(objective, has_aux=True)(
            self.network,
            self.target_network,
            self.batches(shape),
            hyperparameters(**changes),
            shape,
        )
        return flat(found[0])


def flat(tree: Any) -> np.ndarray:
    return np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(tree)])


def assert_equal(one: np.ndarray, other: np.ndarray) -> None:
    assert np.abs(one).max() > 1e-2
    np.testing.assert_allclose(one, other, rtol=2e-4, atol=2e-6)


def differ(one: np.ndarray, other: np.ndarray) -> bool:
    return np.abs(one - other).max() > 1e-2 * np.abs(one).max()


def conservative_q_loss(
    network: QNetwork, target_network: QNetwork, data: Batch, source: str
) -> jax.Array:
    """CQL(H) on the reward m = w λ R / κ, written independently (theory: offline identity).

    τ E[-log softmax(Q/τ)(a)] + κ E[(Q - γ (1 - d) V(s') - m)²].
    """
    tau, gamma = NUMBERS.temperature, NUMBERS.discount
    q, at_next = (
        jax.vmap(network)(data.observation),
        network if source == "online" else target_network,
    )
    q_next = jax.vmap(at_next)(data.next_observation)
    value = tau * jnp.log(jnp.exp(q_next / tau).sum(axis=1))
    absorbing = tau * np.log(N_ACTIONS) / (1 - gamma)
    follows = jnp.array([1, 0, 0, 1, 0])[data.ending] * value  # none, timeout: V(s')
    follows = follows + jnp.array([0, 0, 1, 0, 0])[data.ending] * absorbing  # collision
    weights = exact_weights(NUMBERS.angle)
    score = weights.env * data.target.env + weights.social * data.target.social
    centre = NUMBERS.prior_weight * NUMBERS.strength * score / KAPPA
    rows = jnp.arange(SIZE)
    likelihood = jax.nn.log_softmax(q / tau)[rows, data.action]
    residual = q[rows, data.action] - gamma * follows - centre
    return -tau * likelihood.mean() + KAPPA * (residual**2).mean()


@seeds
@both_sources
def test_offline_iq_learn_with_the_prior_is_conservative_q_learning(seed, next_value):
    problem = Problem(seed)
    shape = static(**EXPERT_ONLY, next_value=next_value)
    arguments = problem.network, problem.target_network, problem.expert, next_value
    assert_equal(problem.gradient(shape), flat(jax.grad(conservative_q_loss)(*arguments)))
    score = jnp.stack(problem.expert.target).T @ jnp.array(exact_weights(NUMBERS.angle))
    constant = C * NUMBERS.prior_weight / KAPPA * NUMBERS.strength**2 * (score**2).mean()
    expected = conservative_q_loss(*arguments) + constant
    assert problem.terms(shape)["loss"] == pytest.approx(float(expected), rel=1e-5)


@seeds
def test_the_conservative_q_learner_is_offline_iq_learn_at_one_conservatism(seed):
    """2 κ times its gradient, where α_CQL = 1 / (2 κ) and its reward is the shrunk centre."""
    problem, shape = Problem(seed), static(**EXPERT_ONLY)
    settings = cql.CQLHyperparameters(
        angle=NUMBERS.angle,
        strength=NUMBERS.strength * NUMBERS.prior_weight / KAPPA,
        conservatism=1 / (2 * KAPPA),
        temperature=NUMBERS.temperature,
        discount=NUMBERS.discount,
    )
    run = stack([settings])[0]
    config = cql.CQLConfig(endings=shape.endings, batch_size=SIZE)
    slope, _ = jax.grad(cql.ConservativeQ(config, (1, 1)).loss, has_aux=True)(
        problem.network, problem.target_network, problem.expert, run
    )
    assert_equal(problem.gradient(shape), 2 * KAPPA * flat(slope))


@seeds
def test_the_two_quadratics_are_one_with_a_shrunk_centre(seed):
    """c r² + w (r - λR)² = (c + w) (r - λR w/(c + w))² + constant."""
    problem = Problem(seed)
    merged = problem.gradient(
        static(prior="shifted_chi2"),
        chi2_alpha=1 / (4 * KAPPA),
        strength=NUMBERS.strength * NUMBERS.prior_weight / KAPPA,
        prior_weight=1.0,
    )
    assert_equal(problem.gradient(static(prior="reward")), merged)


@seeds
def test_strength_zero_is_not_iq_learn_but_iq_learn_with_more_shrinkage(seed):
    """The thesis says that λ = 0 recovers IQ-Learn (4.3.1); at w = 1 it turns α_χ 1/2 into 1/6."""
    problem = Problem(seed)
    zero = problem.gradient(static(prior="reward"), strength=0.0, prior_weight=1.0)
    plain = static(prior="none")
    assert_equal(zero, problem.gradient(plain, chi2_alpha=1 / 6))
    assert differ(zero, problem.gradient(plain))


@seeds
def test_prior_weight_zero_is_iq_learn(seed):
    problem = Problem(seed)
    plain = problem.gradient(static(prior="none"))
    assert_equal(problem.gradient(static(prior="reward"), prior_weight=0.0), plain)
    assert differ(problem.gradient(static(prior="reward")), plain)


@seeds
def test_the_bellman_shift_is_inert_with_chi2_in_term_1_alone(seed):
    """φ' = 1 there, so the shift of B.1 is a constant of the loss."""
    problem = Problem(seed)
    shifted, plain = static(prior="bellman_shift"), static(prior="none")
    np.testing.assert_array_equal(problem.gradient(shifted), problem.gradient(plain))
    difference = problem.terms(shifted)["expert"] - problem.terms(plain)["expert"]
    assert abs(difference) > 1e-2


@pytest.mark.parametrize("chi2_on", ["expert", "mixture"])
def test_the_bellman_shift_inside_term_3_is_the_shifted_chi2(chi2_on):
    problem = Problem(0)
    everywhere = static(
        prior="bellman_shift", shift_term_3=True, chi2_on=chi2_on, target_kind="instantaneous"
    )
    centred = static(prior="shifted_chi2", chi2_on=chi2_on, target_kind="instantaneous")
    assert_equal(problem.gradient(everywhere), problem.gradient(centred, prior_weight=1.0))


@pytest.mark.parametrize("divergence", ["kl", "reverse_kl", "hellinger", "js"])
def test_the_bellman_shift_steers_under_other_divergences(divergence):
    problem = Problem(0)
    shifted = problem.gradient(static(prior="bellman_shift", divergence=divergence))
    assert differ(shifted, problem.gradient(static(prior="none", divergence=divergence)))


@seeds
@pytest.mark.parametrize(
    ("term", "mixed", "half"),
    [
        ("value", {}, {"value_term": "value_expert"}),
        ("chi2", {"chi2_on": "mixture"}, {"chi2_on": "expert"}),
    ],
)
def test_a_term_over_the_mixture_is_the_mean_over_its_halves(seed, term, mixed, half):
    problem = Problem(seed)
    whole = problem.terms(static(**mixed))[term]
    first = problem.terms(static(**half))[term]
    problem.expert = problem.replay
    second = problem.terms(static(**half))[term]
    assert whole == pytest.approx(float(first + second) / 2, rel=1e-5)
    assert abs(first - second) > 1e-2


def test_terms_on_demonstrations_do_not_see_the_replay():
    one, other = Problem(0), Problem(0)
    other.replay = batch(999)
    terms, others = (problem.terms(static()) for problem in (one, other))
    for name in ("expert", "chi2", "prior", "expert_reward"):
        assert terms[name] == others[name]
    assert terms["value"] != others["value"]


def test_term_2_over_initial_states_sees_nothing_else():
    problem, shape = Problem(0), static(value_term="v0")
    q = jax.vmap(problem.network)(problem.initial) / NUMBERS.temperature
    expected = 0.1 * NUMBERS.temperature * np.log(np.exp(q).sum(axis=1)).mean()
    assert problem.terms(shape)["value"] == pytest.approx(expected, rel=1e-5)


def moved(network: QNetwork, direction: QNetwork, step: float) -> QNetwork:
    return jax.tree.map(lambda leaf, way: leaf + step * way, network, direction)


@both_sources
def test_only_online_does_the_gradient_pass_through_the_next_value(next_value):
    """Finite differences: with the target network held fixed, and with it moving along."""
    with jax.enable_x64(True):
        problem, shape = Problem(0), static(next_value=next_value)
        network, way = jax.tree.map(
            lambda leaf: leaf.astype(jnp.float64), (problem.network, problem.target_network)
        )

        @jax.jit
        def loss(step: float, slow_step: float) -> jax.Array:
            copies = moved(network, way, step), moved(network, way, slow_step)
            return objective(*copies, problem.batches(shape), hyperparameters(), shape)[0]

        held = float(loss(1e-5, 0.0) - loss(-1e-5, 0.0)) / 2e-5
        along = float(loss(1e-5, 1e-5) - loss(-1e-5, -1e-5)) / 2e-5
        slope = float(jax.jit(jax.grad(lambda step: loss(step, 0.0)))(0.0))
    assert slope == pytest.approx(held, rel=1e-6)
    if next_value == "target":
        assert abs(along - held) > 1e-2
    else:
        assert along == held
