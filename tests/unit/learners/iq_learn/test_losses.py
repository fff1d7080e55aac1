import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.iq_learn.divergences import DIVERGENCES, phi

KINDS = jnp.arange(5)  # NONE, ARRIVAL, COLLISION, TIMEOUT, OTHER


def column(*values: float) -> jax.Array:
    return jnp.array(values, jnp.float32)


def test_soft_value_by_hand() -> None:
    q = jnp.log(jnp.array([[1.0, 3.0], [2.0, 6.0]]))
    np.testing.assert_allclose(losses.soft_value(q, 1.0), np.log([4, 8]), rtol=1e-6)
    np.testing.assert_allclose(losses.soft_value(2 * q, 2.0), 2 * np.log([4, 8]), rtol=1e-6)


def test_soft_value_tends_to_the_maximum_and_never_overflows() -> None:
    assert losses.soft_value(column(1e4, 3.0), 0.01) == pytest.approx(1e4)


def test_an_absorbing_state_is_worth_its_entropy_for_ever() -> None:
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
def test_continuation_decides_by_the_kind_of_ending(endings: Endings, expected: list) -> None:
    found = losses.continuation(column(1, 2, 3, 4, 5), KINDS, endings.by_kind(), 9.0)
    np.testing.assert_array_equal(found, expected)


def test_implicit_reward_by_hand() -> None:
    found = losses.implicit_reward(column(2, 1), column(4, 0), 0.5)
    np.testing.assert_allclose(found, [0, 1])


@pytest.mark.parametrize(
    ("divergence", "expected"),
    [("chi2", 0.5), ("kl", 0.5), ("reverse_kl", 5.0), ("hellinger", 50.0)],
)
def test_expert_term_by_hand(divergence: str, expected: float) -> None:
    """r̂ = (0, -1): -(0 + φ'(-1)(-1))/2, with φ' = 1, 1, 10 and 100 (at the floors)."""
    found = losses.expert_term(divergence, column(0, -1))
    assert found == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("divergence", DIVERGENCES)
def test_expert_term_has_the_gradient_of_the_paper(divergence: str) -> None:
    reward = column(-12, -3, -0.4, 0.05, 0.7, 4)
    found = jax.grad(lambda r: losses.expert_term(divergence, r))(reward)
    expected = jax.grad(lambda r: -jnp.mean(phi(divergence, r)))(reward)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_value_terms_by_hand() -> None:
    assert losses.value_term(column(3, 5), column(2, 0), 0.5) == pytest.approx(3.5)
    assert losses.initial_value_term(column(1, 3), 0.9) == pytest.approx(0.2, rel=1e-5)


def test_chi2_term_by_hand() -> None:
    assert losses.chi2_term(column(1, -2), 0.5) == pytest.approx(1.25)
    assert losses.chi2_term(column(1, -2), 0.25) == pytest.approx(2.5)
