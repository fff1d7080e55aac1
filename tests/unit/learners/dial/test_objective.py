import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.dial.config import Hyperparameters, StaticConfig
from socialiq.learners.dial.objective import Networks, objective
from socialiq.learners.dial.rows import Rows, at_other_times, draw_directions
from socialiq.learners.expert_table import Batch
from socialiq.learners.state import stack
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_network import QNetwork
from socialiq.types import Ending, RewardPair

STRUCTURE = StaticConfig(hidden=(4,))
NUMBERS = stack(
    [
        Hyperparameters(
            strength=2.0,
            prior_weight=3.0,
            temperature=0.5,
            discount=0.9,
            chi2_alpha=0.25,
            shrinkage=0.3,
            spread=0.2,
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


def by_hand(
    network: DialNetwork, rows: Rows, scored: slice, skill: np.ndarray | None = None
) -> tuple[float, float, float]:
    """The three terms in plain loops; `skill` is f(s, a) of each row."""
    added = np.zeros(4) if skill is None else skill
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
        prior.append((reward - 2.0 * told - added[row]) ** 2)
    weight = 3.0 / (4 * 0.25)
    return (
        float(-np.mean(expert[: rows.n_expert])),
        float(np.mean(value)),
        float(weight * np.mean(prior[scored])),
    )


@pytest.mark.parametrize(
    ("scored", "rows_scored"), [("all", slice(None)), ("demonstrations", slice(2))]
)
def test_the_loss_is_its_formula_at_each_rows_own_angle(scored: str, rows_scored: slice) -> None:
    network = DialNetwork.initialise(jax.random.key(0), 3, (4,), 2)
    rows = Rows(batch(), angles(0.0, 30.0, 60.0, 90.0), 2)
    static = dataclasses.replace(STRUCTURE, scored=scored)
    total, terms = objective(Networks(network, None), network, rows, NUMBERS, static)
    expected = by_hand(network, rows, rows_scored)
    found = [float(terms[name]) for name in ("expert", "value", "prior")]
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert float(total) == pytest.approx(sum(expected), rel=1e-5)


def test_without_demonstrations_only_the_quadratic_is_left() -> None:
    network = DialNetwork.initialise(jax.random.key(0), 3, (4,), 2)
    rows = Rows(batch(), angles(0.0, 30.0, 60.0, 90.0), 0)
    static = dataclasses.replace(STRUCTURE, demonstrations=False)
    total, terms = objective(Networks(network, None), network, rows, NUMBERS, static)
    assert set(terms) == {"prior", "max_q", "loss"}
    expected = by_hand(network, rows._replace(n_expert=2), slice(None))[2]
    assert float(total) == pytest.approx(expected, rel=1e-5)


def test_the_skill_is_learned_at_the_demonstrators_own_angles_and_added_to_the_score() -> None:
    network = DialNetwork.initialise(jax.random.key(0), 3, (4,), 2)
    skill = QNetwork.initialise(jax.random.key(1), 3, (4,), 2)
    own = angles(0.0, 90.0)
    rows = Rows(batch(), angles(0.0, 30.0, 60.0, 90.0), 2, own)
    static = dataclasses.replace(STRUCTURE, demonstrators=(0.0, 90.0))
    total, terms = objective(Networks(network, skill), network, rows, NUMBERS, static)
    f = np.array([skill(one) for one in rows.batch.observation], np.float64)
    shown = f[np.arange(4), np.asarray(rows.batch.action)]
    moved, size = [], []
    for row in range(2):
        direction = RewardPair(own.env[row], own.social[row])
        q = np.asarray(network(rows.batch.observation[row], direction), np.float64)
        policy = np.exp(q / 0.5) / np.exp(q / 0.5).sum()
        moved.append(policy @ f[row] - shown[row])
        size.append(shown[row] ** 2 + 0.2 * (f[row] ** 2).sum())
    expected = np.mean(moved) + 0.3 * np.mean(size)
    assert float(terms["skill"]) == pytest.approx(expected, rel=1e-5)
    prior = by_hand(network, rows, slice(None), shown)[2]
    assert float(terms["prior"]) == pytest.approx(prior, rel=1e-5)
    assert set(terms) == {"skill", "prior", "max_q", "loss"}
    assert float(total) == pytest.approx(expected + prior, rel=1e-5)


def test_angles_are_drawn_between_the_ends_and_a_little_beyond() -> None:
    static = dataclasses.replace(STRUCTURE, low=10.0, high=50.0, margin=5.0)
    drawn = draw_directions(jax.random.key(0), 4000, static)
    degrees = np.degrees(np.arctan2(drawn.social, drawn.env))
    assert 5.0 <= degrees.min() < 5.5
    assert 54.5 < degrees.max() <= 55.001
    assert abs(degrees.mean() - 30.0) < 1.0  # 4 standard errors
    np.testing.assert_allclose(np.hypot(drawn.env, drawn.social), 1.0, rtol=1e-6)


def test_redrawn_times_move_the_clock_and_its_timeouts_alone() -> None:
    before = batch()
    after = at_other_times(jax.random.key(3), before, horizon=2)
    np.testing.assert_array_equal(after.observation[:, :-1], before.observation[:, :-1])
    time = np.asarray(after.observation[:, -1])
    assert set(time.tolist()) <= {0.0, 1.0}
    np.testing.assert_array_equal(after.next_observation[:, -1], time + 1)
    expected = np.where(time == 1.0, int(Ending.TIMEOUT), int(Ending.NONE))
    expected[1] = int(Ending.ARRIVAL)  # a terminal state ends at any time
    np.testing.assert_array_equal(after.ending, expected)
