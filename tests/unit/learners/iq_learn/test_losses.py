import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.iq_learn.losses import DIVERGENCES, phi, phi_slope

KINDS = jnp.arange(5)  # NONE, ARRIVAL, COLLISION, TIMEOUT, OTHER


def column(*values: float) -> jax.Array:
    return jnp.array(values, jnp.float32)


def test_soft_value_by_hand():
    q = jnp.log(jnp.array([[1.0, 3.0], [2.0, 6.0]]))
    np.testing.assert_allclose(losses.soft_value(q, 1.0), np.log([4, 8]), rtol=1e-6)
    np.testing.assert_allclose(losses.soft_value(2 * q, 2.0), 2 * np.log([4, 8]), rtol=1e-6)


def test_soft_value_tends_to_the_maximum_and_never_overflows():
    assert losses.soft_value(column(1e4, 3.0), 0.01) == pytest.approx(1e4)


def test_an_absorbing_state_is_worth_its_entropy_for_ever():
    value = float(losses.absorbing_value(3, 2.0, 0.9))
    assert value == pytest.approx(2 * np.log(3) / 0.1, rel=1e-6)
    assert value == pytest.approx(2 * np.log(3) + 0.9 * value, rel=1e-6)


@pytest.mark.parametrize(
    ("endings", "expected"),
    [
        (Endings(), [1, 0, 0, 0, 0]),  # the thesis: every end is terminal
        (Endings(timeout="bootstrap"), [1, 0, 0, 4, 0]),
        (Endings("absorbing", "zero", "bootstrap", "absorbing"), [1, 9, 0, 4, 9]),
        (Endings("bootstrap", "bootstrap", "zero", "bootstrap"), [1, 2, 3, 0, 5]),
    ],
)
def test_continuation_decides_by_the_kind_of_ending(endings, expected):
    found = losses.continuation(column(1, 2, 3, 4, 5), KINDS, endings.by_kind(), 9.0)
    np.testing.assert_array_equal(found, expected)


def test_implicit_reward_by_hand():
    found = losses.implicit_reward(column(2, 1), column(4, 0), 0.5)
    np.testing.assert_allclose(found, [0, 1])


@pytest.mark.parametrize(
    ("divergence", "expected"),
    [("chi2", 0.5), ("kl", 0.5), ("reverse_kl", 5.0), ("hellinger", 50.0)],
)
def test_expert_term_by_hand(divergence, expected):
    """r̂ = (0, -1): -(0 + φ'(-1)(-1))/2, with φ' = 1, 1, 10 and 100 (at the floors)."""
    found = losses.expert_term(divergence, column(0, -1))
    assert found == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("divergence", DIVERGENCES)
def test_expert_term_has_the_gradient_of_the_paper(divergence):
    reward = column(-12, -3, -0.4, 0.05, 0.7, 4)
    found = jax.grad(lambda r: losses.expert_term(divergence, r))(reward)
    expected = jax.grad(lambda r: -jnp.mean(phi(divergence, r)))(reward)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_value_terms_by_hand():
    assert losses.value_term(column(3, 5), column(2, 0), 0.5) == pytest.approx(3.5)
    assert losses.initial_value_term(column(1, 3), 0.9) == pytest.approx(0.2, rel=1e-5)


def test_chi2_term_by_hand():
    assert losses.chi2_term(column(1, -2), 0.5) == pytest.approx(1.25)
    assert losses.chi2_term(column(1, -2), 0.25) == pytest.approx(2.5)


FLOORS = {name: one.floor for name, one in DIVERGENCES.items() if one.floor is not None}
each = pytest.mark.parametrize("name", DIVERGENCES)

# The generators f of the divergences, f(1) = 0 (Garg et al. 2021, appendix).
GENERATORS = {
    "chi2": lambda t: (t - 1) ** 2,
    "kl": lambda t: t * np.log(t),
    "reverse_kl": lambda t: -np.log(t),
    "hellinger": lambda t: (1 - np.sqrt(t)) ** 2,
    "js": lambda t: t * np.log(t) - (t + 1) * np.log((t + 1) / 2),
}


def grid(name: str) -> np.ndarray:
    """Rewards on both sides of the floor, none of them on it."""
    floor = FLOORS.get(name, 0.0)
    return floor + np.concatenate([-np.geomspace(5, 0.01, 20), np.geomspace(0.01, 12, 40)])


@each
def test_slope_is_the_gradient_on_both_sides_of_the_floor(name):
    rewards = jnp.asarray(grid(name), jnp.float32)
    gradient = jax.vmap(jax.grad(lambda x: phi(name, x)))(rewards)
    np.testing.assert_allclose(phi_slope(name, rewards), gradient, rtol=1e-5)


@each
def test_phi_is_concave_and_rises(name):
    slopes = np.asarray(phi_slope(name, jnp.asarray(grid(name), jnp.float32)))
    assert (slopes > 0).all()
    assert (np.diff(slopes) <= 0).all()


@pytest.mark.parametrize("name", FLOORS)
def test_phi_is_continuous_at_the_floor_and_straight_below(name):
    floor = FLOORS[name]
    below, at, above = (float(phi(name, floor + step)) for step in (-1e-5, 0.0, 1e-5))
    assert below == pytest.approx(at, rel=1e-3)
    assert above == pytest.approx(at, rel=1e-3)
    slope = float(phi_slope(name, floor))
    assert phi(name, floor - 3.0) == pytest.approx(at - 3 * slope, rel=1e-5)
    assert phi_slope(name, -1e6) == pytest.approx(slope)


@pytest.mark.parametrize(
    ("name", "reward", "value", "slope"),
    [
        ("chi2", -7.5, -7.5, 1.0),
        ("kl", -1.0, -1.0, 1.0),
        ("kl", np.log(2) - 1, -0.5, 0.5),
        ("reverse_kl", 1.0, 1.0, 1.0),
        ("reverse_kl", 2.0, 1.6931472, 0.5),
        ("reverse_kl", -0.1, 1 + np.log(0.1) - 2, 10.0),  # tangent at the floor 0.1
        ("hellinger", 1.0, 0.5, 0.25),
        ("hellinger", -0.5, -1.0, 4.0),
        ("js", 0.0, 0.0, 1.0),
        ("js", np.log(2), 0.4054651, 1 / 3),
    ],
)
def test_values_by_hand(name, reward, value, slope):
    assert phi(name, jnp.float32(reward)) == pytest.approx(value, rel=1e-5, abs=1e-7)
    assert phi_slope(name, jnp.float32(reward)) == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "rewards"),
    [
        ("chi2", [-3.0, 0.0, 1.5]),
        ("kl", [-3.0, 0.0, 2.0]),
        ("reverse_kl", [0.15, 1.0, 4.0]),
        ("hellinger", [-0.85, 0.0, 3.0]),
        ("js", [-0.55, 0.0, 2.0]),
    ],
)
def test_phi_is_minus_the_conjugate_of_the_generator(name, rewards):
    """φ(x) = -f*(-x) = min_t (t x + f(t)), and φ' is the density ratio t that attains it.

    χ² has only its linear part in term 1; term 3 has the rest, -x²/4 for this f.
    """
    ratios = np.geomspace(1e-4, 1e3, 200_001)
    for reward in rewards:
        objective = ratios * reward + GENERATORS[name](ratios)
        quadratic = (0.25 * reward**2, 0.5 * reward) if name == "chi2" else (0.0, 0.0)
        found = float(phi(name, jnp.float32(reward))) - quadratic[0]
        slope = float(phi_slope(name, jnp.float32(reward))) - quadratic[1]
        assert found == pytest.approx(objective.min(), rel=1e-5, abs=1e-6)
        assert slope == pytest.approx(ratios[objective.argmin()], rel=1e-3)


def test_the_value_by_occupancy_by_hand():
    """Reached by demonstrations alone, both alike, the learner alone, three to one, none."""
    shown, own = column(0.1, 0.1, 0.0, 0.3, 0.0), column(0.0, 0.1, 0.2, 0.1, 0.0)
    found = losses.occupancy_value(shown, own, 0.9, 0.5)
    np.testing.assert_allclose(found, [20, 0, -20, 10, 0], rtol=1e-5)


DISCOUNT, ALPHA = 0.5, 0.25
EXPERT, OWN = (6, 2), (5, 3)
"""Of eight decisions in a start state, those that lead into the endless states A and B."""


def _objective(q: jax.Array, temperature: float) -> jax.Array:
    """Terms 1 to 3 with the endless states as rows: q is (Q(s, 0), Q(s, 1), Q(A), Q(B)).

    At γ = 1/2 the start state and the endless states have half of the occupancy each, so that a
    side has a row into itself of A or B for each decision that leads there.
    """
    start = losses.soft_value(q[:2], temperature)
    value, after, taken = [], [], []
    for counts in (EXPERT, OWN):
        value += [jnp.repeat(start, 8), jnp.repeat(q[2:], jnp.array(counts), total_repeat_length=8)]
        chosen = jnp.repeat(q[:2], jnp.array(counts), total_repeat_length=8)
        taken += [chosen, value[-1]]
        after += [value[-1], value[-1]]
    value, after, taken = (jnp.concatenate(one) for one in (value, after, taken))
    reward = losses.implicit_reward(taken, after, DISCOUNT)
    terms = losses.expert_term("chi2", reward[:16]) + losses.value_term(value, after, DISCOUNT)
    return terms + losses.chi2_term(reward, ALPHA)


def test_the_value_by_occupancy_minimizes_the_objective_with_endless_states_as_rows():
    """At the temperature at which the minimum's own policy drives as the replay: 5 to 3."""
    slope = jax.jit(jax.value_and_grad(_objective))

    def minimum(temperature: float) -> np.ndarray:
        def loss(q: np.ndarray) -> tuple[float, np.ndarray]:
            value, gradient = slope(jnp.asarray(q, jnp.float32), temperature)
            return float(value), np.asarray(gradient, float)

        return minimize(loss, np.zeros(4), jac=True, method="BFGS", options={"gtol": 1e-6}).x

    def excess(temperature: float) -> float:
        q = minimum(temperature)
        return (q[0] - q[1]) / temperature - np.log(5 / 3)

    q = minimum(brentq(excess, 0.05, 20.0, xtol=1e-4))
    expected = losses.occupancy_value(column(*EXPERT), column(*OWN), DISCOUNT, ALPHA)
    np.testing.assert_allclose(q[2:], expected, atol=2e-3)
    assert np.abs(q[2:]).max() <= losses.reward_bound(ALPHA) / (1 - DISCOUNT)


def test_value_bounds_by_hand():
    """Rewards within 4 * 0.5 = 2, for ever at γ = 0.9, and the entropy log 2 a step above."""
    low, high = losses.value_bounds(2, 1.0, 0.9, 0.5)
    assert float(low) == pytest.approx(-20.0, rel=1e-6)
    assert float(high) == pytest.approx(20.0 + 10.0 * np.log(2.0), rel=1e-6)


def test_an_ending_by_occupancy_takes_the_value_of_its_kind():
    treatment = Endings("occupancy", "zero", "bootstrap", "occupancy").by_kind()
    by_kind = column(9, 10, 11, 12, 13)
    found = losses.continuation(column(1, 2, 3, 4, 5), KINDS, treatment, 7.0, by_kind)
    np.testing.assert_array_equal(found, [1, 10, 0, 4, 13])
