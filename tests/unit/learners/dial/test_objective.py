import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.dial.objective import objective
from socialiq.learners.dial.rows import Rows, at_other_times, draw_directions, draw_rows
from socialiq.learners.expert_table import Batch, Replay
from socialiq.learners.state import stack
from socialiq.nn.dial_network import DialNetwork
from socialiq.types import Ending, RewardPair

STRUCTURE = DialConfig(hidden=(4,))
NUMBERS = stack(
    [
        DialHyperparameters(
            strength=2.0,
            prior_weight=3.0,
            temperature=0.5,
            discount=0.9,
            chi2_alpha=0.25,
        )
    ]
)[0]


def batch(size: int = 4) -> Batch:
    rng = np.random.default_rng(1)
    hyperparameters = jnp.asarray(rng.normal(size=(size, 3)), jnp.float32)
    return Batch(
        observation=hyperparameters,
        action=jnp.asarray(rng.integers(2, size=size)),
        next_observation=hyperparameters[::-1],
        ending=jnp.array([Ending.NONE, Ending.ARRIVAL, Ending.TIMEOUT, Ending.NONE])[:size],
        target=RewardPair(jnp.arange(4.0)[:size], -jnp.ones(4)[:size]),
    )


def angles(*degrees: float) -> RewardPair:
    radians = jnp.deg2rad(jnp.array(degrees))
    return RewardPair(jnp.cos(radians), jnp.sin(radians))


def by_hand(network: DialNetwork, rows: Rows, scored: slice) -> tuple[float, float, float]:
    """The three terms in plain loops."""
    expert, value, prior = [], [], []
    for row in range(4):
        one = jax.tree.map(lambda leaf, row=row: leaf[row], (rows.batch, rows.direction))
        transition, direction = one
        q = np.asarray(network(transition.observation, direction), np.float64)
        q_next = np.asarray(network(transition.next_observation, direction), np.float64)
        v = 0.5 * np.log(np.exp(q / 0.5).sum())
        goes_on = transition.ending == Ending.NONE
        follows = 0.9 * (0.5 * np.log(np.exp(q_next / 0.5).sum()) if goes_on else 0.0)
        reward = q[int(transition.action)] - follows
        told = direction.env * transition.target.env + direction.social * transition.target.social
        expert.append(reward)
        value.append(v - follows)
        prior.append((reward - 2.0 * told) ** 2)
    weight = 3.0 / (4 * 0.25)
    return (
        float(-np.mean(expert[: rows.n_expert])),
        float(np.mean(value)),
        float(weight * np.mean(prior[scored])),
    )


@pytest.mark.parametrize(
    ("scored", "rows_scored"), [("all", slice(None)), ("demonstrations", slice(2))]
)
def test_the_loss_is_its_formula_at_each_rows_own_angle(scored, rows_scored):
    network = DialNetwork.initialise(jax.random.key(0), 3, (4,), 2)
    rows = Rows(batch(), angles(0.0, 30.0, 60.0, 90.0), 2)
    static = dataclasses.replace(STRUCTURE, scored=scored)
    total, terms = objective(network, network, rows, NUMBERS, static)
    expected = by_hand(network, rows, rows_scored)
    found = [float(terms[name]) for name in ("expert", "value", "prior")]
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert float(total) == pytest.approx(sum(expected), rel=1e-5)


def test_without_demonstrations_only_the_quadratic_is_left():
    network = DialNetwork.initialise(jax.random.key(0), 3, (4,), 2)
    rows = Rows(batch(), angles(0.0, 30.0, 60.0, 90.0), 0)
    static = dataclasses.replace(STRUCTURE, demonstrations=False)
    total, terms = objective(network, network, rows, NUMBERS, static)
    assert set(terms) == {"prior", "max_q", "loss"}
    expected = by_hand(network, rows._replace(n_expert=2), slice(None))[2]
    assert float(total) == pytest.approx(expected, rel=1e-5)


def test_angles_are_drawn_between_the_ends_and_a_little_beyond():
    static = dataclasses.replace(STRUCTURE, low=10.0, high=50.0, margin=5.0)
    drawn = draw_directions(jax.random.key(0), 4000, static)
    degrees = np.degrees(np.arctan2(drawn.social, drawn.env))
    assert 5.0 <= degrees.min() < 5.5
    assert 54.5 < degrees.max() <= 55.001
    assert abs(degrees.mean() - 30.0) < 1.0  # 4 standard errors
    np.testing.assert_allclose(np.hypot(drawn.env, drawn.social), 1.0, rtol=1e-6)


def test_redrawn_times_move_the_clock_and_its_timeouts_alone():
    before = batch()
    after = at_other_times(jax.random.key(3), before, horizon=2)
    np.testing.assert_array_equal(after.observation[:, :-1], before.observation[:, :-1])
    time = np.asarray(after.observation[:, -1])
    assert set(time.tolist()) <= {0.0, 1.0}
    np.testing.assert_array_equal(after.next_observation[:, -1], time + 1)
    expected = np.where(time == 1.0, int(Ending.TIMEOUT), int(Ending.NONE))
    expected[1] = int(Ending.ARRIVAL)  # a terminal state ends at any time
    np.testing.assert_array_equal(after.ending, expected)


def test_a_timeouts_reward_moves_with_it():
    before = batch()  # row 2 timed out
    after = at_other_times(jax.random.key(3), before, horizon=2, timeout_reward=-0.5)
    now = np.asarray(after.ending) == int(Ending.TIMEOUT)
    had = np.array([False, False, True, False])
    expected = np.asarray(before.target.env) - 0.5 * now + 0.5 * had
    np.testing.assert_allclose(after.target.env, expected)
    assert (now != had).any()


def test_some_rows_may_keep_their_time():
    rng = np.random.default_rng(0)
    own = jnp.asarray(rng.integers(20, size=4000), jnp.float32)
    one = jax.tree.map(lambda column: jnp.repeat(column[:1], 4000, axis=0), batch())
    before = one._replace(observation=one.observation.at[:, -1].set(own))
    after = at_other_times(jax.random.key(3), before, 20, share=0.4)
    kept = np.asarray(after.observation[:, -1] == own).mean()
    assert abs(kept - (0.6 + 0.4 / 20)) < 0.04  # 5 standard errors
    untouched = at_other_times(jax.random.key(3), before, 20, share=0.0)
    np.testing.assert_array_equal(untouched.observation, before.observation)
    timed_out = np.asarray(untouched.ending) == int(Ending.TIMEOUT)
    np.testing.assert_array_equal(timed_out, np.asarray(own) == 19)


HARD = dataclasses.replace(STRUCTURE, backup="hard", demonstrations=False)
DOUBLE = dataclasses.replace(HARD, backup="double", heads="pair")


def networks(pairs: bool) -> tuple[DialNetwork, DialNetwork]:
    one, other = (
        DialNetwork.initialise(jax.random.key(key), 3, (4,), 2, pairs=pairs) for key in (0, 7)
    )
    return one, other


def test_a_hard_backup_takes_the_targets_largest_value():
    network, target = networks(pairs=False)
    rows = Rows(batch(), angles(0.0, 30.0, 60.0, 90.0), 0)
    found = float(objective(network, target, rows, NUMBERS, HARD)[1]["prior"])
    gaps = []
    for row in range(4):
        one, direction = jax.tree.map(lambda leaf, row=row: leaf[row], (rows.batch, rows.direction))
        best = float(target(one.next_observation, direction).max())
        follows = 0.9 * best * (int(one.ending) == Ending.NONE)
        told = direction.env * one.target.env + direction.social * one.target.social
        gaps.append((network(one.observation, direction)[one.action] - follows - 2.0 * told) ** 2)
    assert found == pytest.approx(3.0 * float(np.mean(gaps)), rel=1e-5)


def by_hand_of_pairs(
    network: DialNetwork, target: DialNetwork, step: Batch, direction: RewardPair
) -> float:
    """Squares of one transition's two gaps, summed: double, at a direction."""
    q = network.value_pair(step.observation, direction)
    after = target.value_pair(step.next_observation, direction)
    action = int(network(step.next_observation, direction).argmax())
    goes_on = float(int(step.ending) == Ending.NONE)
    return sum(
        float(now[step.action] - 0.9 * goes_on * follows[action] - 2.0 * reward) ** 2
        for now, follows, reward in zip(q, after, step.target, strict=True)
    )


def test_pairs_have_a_quadratic_for_each_reward():
    network, target = networks(pairs=True)
    rows = Rows(batch(), angles(0.0, 30.0, 60.0, 90.0), 0)
    _, terms = objective(network, target, rows, NUMBERS, DOUBLE)
    each = [
        by_hand_of_pairs(network, target, *jax.tree.map(lambda one, row=row: one[row], rows[:2]))
        for row in range(4)
    ]
    assert float(terms["prior"]) == pytest.approx(3.0 * np.mean(each), rel=1e-5)


def test_own_rows_are_learned_at_the_angle_that_was_driven_as_often_as_asked():
    static = dataclasses.replace(
        DOUBLE, driven_share=0.6, replay_batch=2000, replay_capacity=8, redraw_times=0
    )
    rows = batch()._replace(direction=angles(1.0, 1.0, 1.0, 1.0))
    ring = Replay.empty(8, jax.tree.map(lambda column: column[0], rows)).add_many(rows)
    rows = draw_rows(static, None, jnp.zeros(()), ring, jax.random.key(0))
    degrees = np.degrees(np.arctan2(rows.direction.social, rows.direction.env))
    assert abs((np.abs(degrees - 1.0) < 1e-3).mean() - 0.6) < 0.05  # 4 standard errors


def test_large_angles_are_drawn_as_often_as_asked():
    static = dataclasses.replace(STRUCTURE, high_from=65.0, high_share=0.4)
    drawn = draw_directions(jax.random.key(0), 4000, static)
    degrees = np.degrees(np.arctan2(drawn.social, drawn.env))
    assert degrees.min() >= -5.001 and degrees.max() <= 95.001
    assert abs((degrees > 65.0).mean() - 0.4) < 0.04
    assert abs(degrees[degrees < 65.0].mean() - 30.0) < 2.0
    assert abs(degrees[degrees > 65.0].mean() - 80.0) < 1.0


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"heads": "pair"}, "heads=pair has no soft backup"),
        ({"high_share": 1.5}, "high_share"),
        ({"high_share": 0.5, "high_from": 95.0}, "give an angle between 0 and 90"),
        ({"driven_share": 0.5, "online": False}, "train online"),
        ({"timeout_reward": float("nan")}, "finite"),
    ],
)
def test_settings_that_do_not_fit_are_refused(changes, line):
    with pytest.raises(UserError, match=line):
        dataclasses.replace(STRUCTURE, **changes)
