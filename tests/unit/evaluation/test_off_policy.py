from dataclasses import replace

import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.evaluation import fitted_q
from socialiq.evaluation import off_policy as sampling
from socialiq.evaluation.fitted_q import (
    Hyperparameters,
    StaticConfig,
    by_network,
)
from socialiq.evaluation.off_policy import Estimate, Evaluator, Logged
from socialiq.types import Ending, RewardPair

END, CUT, NONE = int(Ending.ARRIVAL), int(Ending.TIMEOUT), int(Ending.NONE)


def one_step(actions, mode=None, names=("demonstrator",)):
    """Return episodes of one step from one state: action 0 pays (1, 0), action 1 (3, 10)."""
    actions = np.asarray(actions)
    count = len(actions)
    return Demonstrations.of(
        observation=np.zeros((count, 1)),
        action=actions,
        next_observation=np.ones((count, 1)),
        ending=np.full(count, END),
        rewards=RewardPair(1.0 + 2.0 * actions, 10.0 * actions),
        episode=np.arange(count),
        n_actions=2,
        mode=mode,
        mode_names=names,
    )


def waiting(lengths, ending=CUT):
    """Return episodes in one state that pays (1, -2) a step until they are cut."""
    total = sum(lengths)
    episode = np.repeat(np.arange(len(lengths)), lengths)
    endings = np.full(total, NONE)
    endings[np.cumsum(lengths) - 1] = ending
    return Demonstrations.of(
        observation=np.zeros((total, 1)),
        action=np.zeros(total),
        next_observation=np.zeros((total, 1)),
        ending=endings,
        rewards=RewardPair(np.ones(total), np.full(total, -2.0)),
        episode=episode,
        n_actions=2,
    )


def always(*chances):
    return lambda observations: np.tile(chances, (len(observations), 1))


def test_one_step_by_hand():
    """Seen three times in four, taken once in four: both estimates reweigh exactly."""
    found = Evaluator(Logged.of(one_step([0, 0, 0, 1] * 20)), 50).evaluate(always(0.25, 0.75))
    for one in (found.weighted, found.whole, found.fitted):
        assert one.totals == pytest.approx([0.25 * 1 + 0.75 * 3, 7.5])
        assert one.value(90.0)[0] == pytest.approx(7.5)
    # ρ is 1/3 sixty times and 3 twenty times: (20 + 60)² / (60/9 + 180)
    assert found.effective == pytest.approx(6400 / (60 / 9 + 180))
    assert found.left == 0 and found.warning == ""


def test_a_policy_that_drives_as_the_data_has_their_mean_return():
    data = one_step([0, 1, 1, 1] * 2)
    found = Evaluator(Logged.of(data), 10).evaluate(always(0.25, 0.75))
    assert found.effective == pytest.approx(8)
    assert found.whole.totals == pytest.approx([one.mean() for one in data.totals()])


def test_of_two_deterministic_demonstrators_only_the_one_that_is_followed_counts():
    data = one_step([0] * 20 + [1] * 5, np.repeat([0, 1], [20, 5]), ("ego", "other"))
    logged = Logged.of(data)
    shares = np.array([0.8, 0.2])
    chances = logged.chances(always(0.0, 1.0))
    ratio = sampling.ratios(logged, chances, sampling.by_counts(logged), shares)
    assert ratio[:, 0] == pytest.approx([0.0] * 20 + [5.0] * 5)
    assert sampling.effective_episodes(ratio) == pytest.approx(5)


def test_steps_to_go_are_summed_without_discount():
    logged = Logged.of(waiting([4, 4, 2]))
    counts = np.array([[1.0, 1.0, 1.0], [3.0, 0.0, 0.0]])
    totals, left = fitted_q.tabular(logged, logged.chances(always(1.0, 0.0)), counts)
    assert totals == pytest.approx(np.array([[4.0, -8.0]] * 2))
    assert left == pytest.approx([0.0, 0.0])


def test_an_end_takes_what_would_have_followed():
    """Half of the rows end the episode: 1 + 1/2 + 1/4 over three steps."""
    data = waiting([1, 1, 3, 1, 1], END)
    logged = Logged.of(data)
    assert data.terminated.mean() == pytest.approx(5 / 7)
    chances = logged.chances(always(1.0, 0.0))
    (total,), _ = fitted_q.tabular(logged, chances, np.ones((1, 5)))
    assert total[0] == pytest.approx(1 + 2 / 7 + (2 / 7) ** 2)


def test_what_no_episode_shows_is_said():
    found = Evaluator(Logged.of(one_step([0] * 12)), 5).evaluate(always(0.5, 0.5))
    assert found.left == pytest.approx(0.5) and not found.fitted_supported
    assert "in 50% of its episodes the policy does what no episode shows" in found.warning
    nothing = Evaluator(Logged.of(one_step([0] * 12)), 5).evaluate(always(0.0, 1.0))
    assert nothing.effective == 0 and np.isnan(nothing.whole.totals).all()
    assert "in 100% of its episodes" in nothing.warning and "(0.0 of 12" in nothing.warning


def test_few_resamples_give_a_t_interval_and_many_their_quantiles():
    few = Estimate(np.array([1.0, 0.0]), np.array([[0.0, 0.0], [2.0, 0.0]]))
    value, low, high = few.value(0.0)
    assert (value, (low + high) / 2) == pytest.approx((1.0, 1.0))
    assert high - value == pytest.approx(12.706 * np.sqrt(2), rel=1e-3)
    many = np.stack([np.arange(1000.0), np.zeros(1000)], axis=1)
    assert Estimate(np.array([500.0, 0.0]), many).value(0.0)[1:] == pytest.approx((24.975, 974.025))


def test_what_no_episode_shows_widens_the_interval():
    """One in ten episodes is unknown, and the logged ones lie 4 apart: 0.4 on both sides."""
    sums = np.array([[1.0, 0.0], [5.0, 0.0]])
    sure = Estimate(np.array([2.0, 0.0]), np.full((200, 2), 2.0))
    assert sure.value(0.0) == pytest.approx((2.0, 2.0, 2.0))
    assert sure._replace(guessed=0.1 * sums).value(0.0) == pytest.approx((2.0, 1.6, 2.4))


def test_what_has_no_answer_is_refused():
    with pytest.raises(UserError, match="one episode has no interval"):
        Logged.of(waiting([4]))
    with pytest.raises(UserError, match="2 or more"):
        Evaluator(Logged.of(one_step([0, 1] * 5)), 1)
    with pytest.raises(UserError, match="the policy has 3 actions, the data 2"):
        Evaluator(Logged.of(one_step([0, 1] * 5)), 5).evaluate(always(0.2, 0.3, 0.5))


@pytest.mark.slow
@pytest.mark.parametrize("unit", [0.0, 1e4])
def test_a_network_finds_what_the_table_has(unit):
    data = waiting([4, 4, 2])
    noise = unit * np.random.default_rng(0).normal(size=(10, 1)).astype(np.float32)
    logged = Logged.of(replace(data, observation=noise, next_observation=noise))
    static = StaticConfig(hidden=(16,), updates=1500, batch_size=32)
    counts = np.array([[1.0, 1.0, 1.0], [2.0, 1.0, 0.0]])
    numbers = Hyperparameters(learning_rate=1e-2, polyak=0.1)
    found = by_network(logged, logged.chances(always(1.0, 0.0)), counts, static, numbers)
    assert found == pytest.approx(np.array([[4.0, -8.0]] * 2), rel=0.02)


def test_clones_know_the_shares_of_a_mode():
    logged = Logged.of(one_step([0, 0, 0, 1] * 10))
    (found,) = sampling.by_clones(logged, updates=400)
    assert found[0] == pytest.approx([0.75, 0.25], abs=0.03)
