"""A driver who knows what comes."""

import numpy as np
import pytest

from socialiq.evaluation.branching import OracleLookahead, with_oracle_lookahead
from socialiq.evaluation.episodes import episodes_of
from socialiq.worlds.intersection.options import FASTER, SLOWER, Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection

SEEDS = np.arange(600, 640)


@pytest.mark.parametrize("angle", [0.0, 90.0])
def test_no_episode_is_worse_with_foresight(angle):
    """The policy's own action is among those looked at, and its known end is reached."""
    plain = episodes_of(Intersection().batch(8), policy("go"), SEEDS)
    seeing = with_oracle_lookahead(Options(), policy("go"), SEEDS, angle, size=8)
    before, after = (
        one.totals.env if angle == 0.0 else one.totals.social for one in (plain, seeing)
    )
    assert (after >= before - 1e-9).all()
    assert after.mean() > before.mean() + 0.1


def test_looking_leaves_the_episode_as_it_is():
    batch = Intersection().batch(3)
    batch.reset([1, 2, 3])
    before = batch.save()
    totals = OracleLookahead(policy("go"), batch, 0.0).totals()
    for column, kept in zip(batch.save(), before, strict=True):
        np.testing.assert_array_equal(column, kept)
    alone = episodes_of(Intersection().batch(3), policy("go"), [1, 2, 3])
    np.testing.assert_allclose(totals[:, FASTER], alone.totals.env)


def test_a_policy_with_a_clock_is_told_the_time():
    class Late:
        """Goes from the fifth second on."""

        n_features = 71

        def predict(self, seen, **_):
            return np.where(seen[:, -1] >= 5, FASTER, SLOWER), None

    plain = episodes_of(Intersection().batch(8), Late(), SEEDS)
    seeing = with_oracle_lookahead(Options(), Late(), SEEDS, 0.0, size=8)
    assert (seeing.totals.env >= plain.totals.env - 1e-9).all()
    assert plain.totals.env.mean() < seeing.totals.env.mean()


def test_episodes_that_have_ended_are_not_looked_at():
    batch = Intersection().batch(2)
    batch.reset([1, 2])
    while (batch.step(np.array([FASTER, FASTER]), auto_reset=False, rows=[0]).ending[0]) == 0:
        pass
    totals = OracleLookahead(policy("go"), batch, 0.0).totals()
    assert (totals[0] == 0).all() and (totals[1] != 0).all()
