"""A dial driven at the intersection, and mixtures that one half of the episodes chooses."""

import jax
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.dial_exact import Sweep
from socialiq.evaluation.dial_rollouts import Rolled, roll
from socialiq.evaluation.play import episodes_of
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import angle_of
from socialiq.social.dial import mixture, setting
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options


@pytest.fixture(name="dial", scope="module")
def untrained() -> DialPolicy:
    network = DialNetwork.initialise(jax.random.key(3), 70, (4,), 3)
    return DialPolicy.of(network, temperature=0.1, low=0.0, high=90.0, provenance={})


def test_every_angle_drives_the_same_episodes(dial: DialPolicy) -> None:
    batch, seeds = Batch(Options(), 4), np.arange(6)
    found = roll(dial, batch, (0.0, 90.0), seeds)
    assert found.sweep.angles == (0.0, 90.0)
    for angle, metrics, totals in zip((0.0, 90.0), found.sweep.metrics, found.totals, strict=True):
        alone = episodes_of(batch, dial.at(angle), seeds)
        np.testing.assert_array_equal(totals, np.stack(alone.totals, axis=1))
        assert metrics == alone.metrics()
        np.testing.assert_allclose(totals.mean(axis=0), metrics.totals)


def test_one_half_of_the_episodes_chooses_and_the_other_measures() -> None:
    rng = np.random.default_rng(0)
    totals = tuple(rng.normal(center, 0.3, (200, 2)) for center in ((3.0, 0.0), (0.0, 2.0)))
    one, shown = Rolled(Sweep((0.0, 90.0), ()), totals).mixture(45.0, seed=7)
    chosen = setting(np.array([sums[:100].mean(axis=0) for sums in totals]), 45.0)
    assert one == chosen and 0.0 < one.share < 1.0
    means = np.array([sums[100:].mean(axis=0) for sums in totals])
    assert shown.angle == pytest.approx(angle_of(*mixture(means, one)))
    assert shown.low <= 45.0 <= shown.high and shown.angle != 45.0


def test_the_interval_knows_that_both_drove_the_same_episodes() -> None:
    """Where one's luck is the other's misfortune the mixture's angle is nearly certain."""
    rng = np.random.default_rng(0)
    luck, east, north = rng.normal(0.0, 1.0, (400, 2)), np.array([3.0, 0.0]), np.array([0.0, 3.0])
    widths = []
    for sign in (1.0, -1.0):
        totals = (luck + east, sign * luck + north)
        _, shown = Rolled(Sweep((0.0, 90.0), ()), totals).mixture(45.0, seed=7)
        widths.append(shown.high - shown.low)
    assert widths[1] < 0.2 * widths[0]


def test_a_mixture_out_of_reach_and_too_few_episodes_are_said(dial: DialPolicy) -> None:
    totals = (np.ones((4, 2)), np.ones((4, 2)))
    with pytest.raises(UserError, match="no mixture of these policies lies at 90 degrees"):
        Rolled(Sweep((0.0, 90.0), ()), totals).mixture(90.0, seed=0)
    with pytest.raises(UserError, match="two episodes or more"):
        roll(dial, Batch(Options(), 1), (0.0,), np.arange(1))
