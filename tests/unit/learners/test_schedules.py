"""Learning rates by hand."""

import jax.numpy as jnp
import pytest

from socialiq.learners.state import cosine, linear


def test_a_linear_rate_reaches_its_end_with_the_last_update():
    rates = [float(linear(1.0, 0.2, jnp.asarray(done), 4)) for done in range(4)]
    assert rates == pytest.approx([0.8, 0.6, 0.4, 0.2])


def test_a_cosine_begins_at_the_first_rate_and_ends_at_its_share():
    rates = [float(cosine(2.0, 0.1, jnp.asarray(done), 4)) for done in (0, 2, 4)]
    assert rates == pytest.approx([2.0, 1.1, 0.2])
