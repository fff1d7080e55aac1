"""Deep Q-learning on a world of one decision: two observations, and action 1 pays 1."""

import dataclasses
import signal

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.callbacks import Callbacks, Report, Stopped
from socialiq.learners.collect import Source
from socialiq.learners.dqn import (
    DQNConfig,
    DQNHyperparameters,
    acting,
    bootstrapped_target,
    next_value,
    policy_of,
    td_loss,
    train,
)
from socialiq.learners.expert_table import Batch
from socialiq.learners.kernel import Trained
from socialiq.nn.q_network import QNetwork
from socialiq.types import Act, Ending, RewardPair

CHUNK, SEEN = 40, np.eye(2, dtype=np.float32)
STRUCTURE = DQNConfig(
    hidden=(8,), batch_size=16, steps=240, steps_per_update=2, replay_capacity=120
)  # 120 updates
NUMBERS = DQNHyperparameters(learning_rate=0.02, final_learning_rate=0.02, polyak=0.1, seed=3)
RUNS = (NUMBERS, dataclasses.replace(NUMBERS, seed=4))


def bandit(social: float = 0.0) -> Source:
    """Action 1 pays 1 to the ego and `social` to the others, and the episode is over."""

    def source(act: Act, rng: np.random.Generator) -> Batch:
        seen = SEEN[rng.integers(2, size=CHUNK * STRUCTURE.steps_per_update)]
        action = np.asarray(act(seen))
        ending = np.full(len(seen), int(Ending.OTHER), np.int32)
        pair = RewardPair(np.float32(action == 1), np.float32(social * (action == 1)))
        return jax.tree.map(jnp.asarray, Batch(seen, action.astype(np.int32), seen, ending, pair))

    return source


def learn(
    *hyperparameters: DQNHyperparameters,
    static: DQNConfig = STRUCTURE,
    callbacks: Callbacks | None = None,
) -> Trained:
    sources = [bandit() for _ in hyperparameters]
    return train(static, hyperparameters, sources, (2, 2), callbacks, chunk=CHUNK)


def learnt_nothing(static: DQNConfig) -> QNetwork:
    """The network that a run of `NUMBERS` begins with."""
    _, key = jax.random.split(jax.random.key(jnp.uint32(NUMBERS.seed)))
    return QNetwork.initialise(key, 2, static.hidden, 2)


@pytest.fixture(name="whole", scope="module")
def uninterrupted():
    return learn(*RUNS)


def test_the_action_that_pays_is_learnt(whole):
    assert whole.failures == ()
    for run in range(2):
        policy = whole.policy(run)
        assert policy.predict(SEEN)[0].tolist() == [1, 1]
        np.testing.assert_allclose(policy.q_values(SEEN), [[0, 1], [0, 1]], atol=0.1)
    assert whole.history.updates == [40, 80, 120]
    assert set(whole.history.values) == {"loss", "max_q"}
    loss = whole.history.array("loss")
    assert (loss[-1] < loss[0] / 5).all()


def test_the_angle_decides_what_pays():
    """If the others lose by it, an ego that counts only them (90 degrees) avoids it."""
    hyperparameters = [dataclasses.replace(NUMBERS, angle=angle) for angle in (0.0, 90.0)]
    sources = [bandit(social=-1.0) for _ in hyperparameters]
    found = train(STRUCTURE, hyperparameters, sources, (2, 2), chunk=CHUNK)
    chosen = [found.policy(run).predict(SEEN)[0].tolist() for run in (0, 1)]
    assert chosen == [[1, 1], [0, 0]]


def chain(ending: Ending) -> Source:
    """The first observation leads to the second, for nothing and with this ending.

    There an episode ends, and action 1 pays 1.
    """

    def source(act: Act, rng: np.random.Generator) -> Batch:
        number = rng.integers(2, size=CHUNK * STRUCTURE.steps_per_update)
        action = np.asarray(act(SEEN[number])).astype(np.int32)
        kind = np.where(number == 1, int(Ending.OTHER), int(ending)).astype(np.int32)
        paid = np.float32((number == 1) & (action == 1))
        after, pair = SEEN[np.ones_like(number)], RewardPair(paid, 0 * paid)
        return jax.tree.map(jnp.asarray, Batch(SEEN[number], action, after, kind, pair))

    return source


@pytest.mark.parametrize(
    ("choices", "expected"),
    [
        ({"double": True, "through_timeouts": True}, [0.5, 0.5, 0.0]),
        ({"double": False, "through_timeouts": False}, [0.5, 0.0, 0.0]),
    ],
)
def test_a_value_travels_back_unless_the_episode_is_over(choices, expected):
    """γ = 1/2; between the observations nothing, a timeout, or an arrival."""
    static = dataclasses.replace(STRUCTURE, **choices)
    sources = [chain(kind) for kind in (Ending.NONE, Ending.TIMEOUT, Ending.ARRIVAL)]
    hyperparameters = [dataclasses.replace(NUMBERS, discount=0.5)] * 3
    found = train(static, hyperparameters, sources, (2, 2), chunk=CHUNK)
    first = [found.policy(run).q_values(SEEN)[0].tolist() for run in range(3)]
    np.testing.assert_allclose(first, [[value, value] for value in expected], atol=0.1)


def test_the_same_seed_gives_the_same_bits_and_another_does_not(whole, assert_same):
    assert_same(learn(*RUNS).networks, whole.networks)
    first, second = (whole.policy(run).q_values(SEEN) for run in (0, 1))
    assert (first != second).any()


def test_a_run_does_not_depend_on_its_neighbours(whole, assert_same):
    found = learn(dataclasses.replace(RUNS[0], seed=9, discount=0.5), RUNS[1])
    assert_same(*(jax.tree.map(lambda leaf: leaf[1], one.networks) for one in (found, whole)))


def test_a_resumed_run_equals_an_uninterrupted_one_bit_for_bit(whole, assert_same, tmp_path):
    path = tmp_path / "state"

    def interrupt(report: Report) -> None:
        if report.done == 80:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(Stopped, match="stopped after 80 of 120 updates"):
        learn(*RUNS, callbacks=Callbacks(interrupt, checkpoint=path))
    around = Callbacks(checkpoint=path, resume=True)
    resumed = learn(*RUNS, callbacks=around)
    assert_same(resumed.networks, whole.networks)
    assert_same(resumed.history.values, whole.history.values)
    with pytest.raises(UserError, match="belongs to a run of other settings"):
        learn(RUNS[0], dataclasses.replace(RUNS[1], discount=0.5), callbacks=around)


@pytest.mark.slow
def test_the_learning_rate_falls_in_a_straight_line_to_the_final_one():
    """Adam's first step is as long as the rate; of 4 steps from 0.04 to 0 that is 0.03."""
    static = dataclasses.replace(STRUCTURE, steps=8)
    hyperparameters = dataclasses.replace(NUMBERS, learning_rate=0.04, final_learning_rate=1e-12)
    biases: list[np.ndarray] = []

    def monitor(state) -> dict[str, np.ndarray]:
        biases.append(np.asarray(state.network.layers[-1].bias[0]))
        return {}

    sources = [bandit()]
    train(static, [hyperparameters], sources, (2, 2), Callbacks(monitor=monitor), chunk=1)
    start = np.asarray(learnt_nothing(static).layers[-1].bias)
    steps = np.abs(np.diff([start, *biases], axis=0)).max(axis=1)
    assert steps[0] == pytest.approx(0.03, rel=1e-3)
    assert steps[3] < 1e-9 < steps[2]


@pytest.mark.parametrize(("done", "share"), [(0, 1.0), (30, 0.6), (60, 0.2), (119, 0.2)])
def test_random_actions_become_as_rare_as_the_numbers_say(done, share):
    hyperparameters = dataclasses.replace(NUMBERS, exploration=0.2, exploration_fall=0.5)
    network, draws = learnt_nothing(STRUCTURE), 20_000
    act = acting(STRUCTURE, [NUMBERS, hyperparameters])(network, 1, done, np.random.default_rng(0))
    actions = act(np.tile(SEEN[0], (draws, 1)))
    best = policy_of(STRUCTURE, hyperparameters, network).predict(SEEN[0])[0]
    # half of the random ones are the best by chance; 4 standard errors are at most 0.015
    assert (actions != best).mean() == pytest.approx(share / 2, abs=0.015)


def test_a_policy_carries_its_origin(whole):
    record = whole.policy(1).provenance
    assert record["learner"] == "dqn"
    assert DQNHyperparameters(**record["numbers"]) == RUNS[1]
    assert DQNConfig(**record["structure"]) == STRUCTURE


@pytest.mark.parametrize(("runs", "sources"), [(0, 0), (2, 1), (1, 2)])
def test_runs_without_a_source_each_are_refused(runs, sources):
    line = f"^{runs} runs and {sources} sources: pass one for each$"
    with pytest.raises(UserError, match=line):
        train(STRUCTURE, RUNS[:runs], [bandit()] * sources, (2, 2))


def test_a_network_that_blows_up_is_told_and_leaves_the_other_alone(whole, assert_same):
    found = learn(RUNS[0], dataclasses.replace(RUNS[1], learning_rate=1e30))
    assert len(found.failures) == 1
    assert found.failures[0].startswith("angle 0, seed 4 stopped at update 0: parameters not fini")
    assert_same(*(jax.tree.map(lambda leaf: leaf[0], one.networks) for one in (found, whole)))


KINDS = jnp.arange(5)  # NONE, ARRIVAL, COLLISION, TIMEOUT, OTHER


def column(*values: float) -> jax.Array:
    return jnp.array(values, jnp.float32)


@pytest.mark.parametrize(("double", "expected"), [(False, [3, 7]), (True, [1, 7])])
def test_next_value_by_hand(double, expected):
    """The network would take actions 0 and 1, the target network actions 2 and 1."""
    target_network, fast = jnp.array([[1.0, 2, 3], [6, 7, 5]]), jnp.array([[9.0, 8, 0], [0, 4, 3]])
    np.testing.assert_array_equal(next_value(target_network, fast, double), expected)


@pytest.mark.parametrize(
    ("through_timeouts", "expected"), [(True, [6, 1, 1, 21, 1]), (False, [6, 1, 1, 1, 1])]
)
def test_the_target_goes_on_where_nothing_ended(through_timeouts, expected):
    """r = 1 and γ = 1/2; the states reached are worth 10, 20, 30, 40 and 50."""
    value, reward = column(10, 20, 30, 40, 50), jnp.ones(5)
    found = bootstrapped_target(reward, value, KINDS, 0.5, through_timeouts)
    np.testing.assert_array_equal(found, expected)


def test_the_loss_is_square_near_the_target_and_straight_far_from_it():
    """Errors 0.5 and -3 cost 0.5 · 0.25 and 3 - 0.5."""
    q, action = jnp.array([[1.5, 99.0], [99.0, -3.0]]), jnp.array([0, 1])
    found = td_loss(q, action, column(1, 0))
    assert found == pytest.approx((0.125 + 2.5) / 2)


def test_only_the_action_taken_is_moved_and_by_one_at_most():
    q, action = jnp.array([[1.5, 99.0], [99.0, -3.0]]), jnp.array([0, 1])
    gradient = jax.grad(td_loss)(q, action, column(1, 0))
    np.testing.assert_allclose(gradient, [[0.5 / 2, 0], [0, -1 / 2]])


@pytest.mark.parametrize(("loss", "minimum"), [("squared", -0.4), ("huber", -1 / 19)])
def test_only_the_squared_loss_learns_the_cost_of_a_rare_collision(loss, minimum):
    """5 % of the targets are -8, the others 0: the mean is -0.4; Huber balances 0.95 q = -0.05."""
    target = jnp.array([-8.0] + [0.0] * 19)

    def at(q: float) -> float:
        return float(td_loss(jnp.full((20, 1), q), jnp.zeros(20, int), target, loss))

    assert at(minimum) < min(at(minimum - 0.02), at(minimum + 0.02))
