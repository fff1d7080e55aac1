"""The offline dial where the best supported policy is known."""

import dataclasses

import jax
import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners.dial.config import (
    OWN_DATA,
    OfflineDialConfig,
    OfflineDialHyperparameters,
)
from socialiq.learners.dial.offline import STAGES, recorded, train
from socialiq.learners.dial.rows import draw_directions
from socialiq.nn.dial_policy import DialPolicy
from socialiq.types import Ending, RewardPair

STATIC = OfflineDialConfig(
    view="flat", hidden=(32,), one_hot=((0, 3),), batch_size=64, updates=400, high_share=None
)
NUMBERS = OfflineDialHyperparameters(learning_rate=1e-2, end_temperature=0.1)
STATES = np.array([[0.0], [1.0]], np.float32)


def two_steps(episodes: int = 200, last: Ending = Ending.ARRIVAL) -> Demonstrations:
    """Episodes of two steps: the first earns r_social, the second r_env.

    Actions 0, 1, 2 earn 0, 1, 9. Action 1 is rare, and no driver takes action 2, the best of all.
    In every hundred episodes each second action follows each first one in proportion: neither has
    an effect on the other step's reward, by chance neither.
    """
    number = np.arange(episodes)
    first, second = (number % 10 < 3).astype(int), (number // 10 % 10 == 0).astype(int)
    earned, nothing = np.array([0.0, 1.0, 9.0]), np.zeros(episodes)

    def in_turn(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.stack([one, other], axis=1).ravel()

    return Demonstrations.of(
        observation=in_turn(nothing, nothing + 1)[:, None],
        action=in_turn(first, second),
        next_observation=in_turn(nothing + 1, nothing + 2)[:, None],
        ending=in_turn(nothing, nothing + int(last)),
        rewards=RewardPair(in_turn(nothing, earned[second]), in_turn(earned[first], nothing)),
        episode=np.repeat(np.arange(episodes), 2),
        n_actions=3,
    )


@pytest.fixture(scope="module")
def trained():
    long = dataclasses.replace(STATIC, updates=3000)  # a dial changes fast near both ends
    return train(long, [NUMBERS], [two_steps()], chunk=1000)


def test_the_best_supported_action_is_chosen_at_every_angle(trained):
    """At 0 degrees only the second step counts, at 90 only the first, between them both."""
    assert tuple(trained) == STAGES
    dial = trained["dial"].policy(0)
    assert isinstance(dial, DialPolicy)
    chosen = {angle: dial.at(angle).predict(STATES)[0].tolist() for angle in (0.0, 45.0, 90.0)}
    assert chosen[45.0] == [1, 1]
    assert chosen[0.0][1] == 1 and chosen[90.0][0] == 1
    assert dial.at(45.0).probabilities(STATES)[:, 2].max() < 0.01


def test_data_of_any_units_are_learned_alike():
    """Features and rewards in other units give the same policy, and a bounded value."""
    data = two_steps()
    other = dataclasses.replace(
        data,
        observation=1e3 * data.observation + 5e3,
        next_observation=1e3 * data.next_observation + 5e3,
        rewards=RewardPair(*(1e-2 * reward for reward in data.rewards)),
    )
    static = OfflineDialConfig(**_static(OWN_DATA), hidden=(32,), batch_size=64)
    numbers = OfflineDialHyperparameters(**_numbers(OWN_DATA), learning_rate=1e-2)
    for table, states in ((data, STATES), (other, 1e3 * STATES + 5e3)):
        dial = train(static, [numbers], [table], chunk=1000)["dial"].policy(0)
        chosen = {angle: dial.at(angle).predict(states)[0].tolist() for angle in (0.0, 45.0, 90.0)}
        assert chosen[45.0] == [1, 1]
        assert chosen[0.0][1] == 1 and chosen[90.0][0] == 1


def _numbers(settings):
    return {name: value for name, value in settings.items() if "temperature" in name}


def _static(settings):
    return {name: value for name, value in settings.items() if "temperature" not in name}


def test_what_earns_nothing_is_imitated(trained):
    dial = trained["dial"].policy(0)
    first = dial.at(0.0).probabilities(STATES)[0]
    second = dial.at(90.0).probabilities(STATES)[1]
    np.testing.assert_allclose(first, [0.7, 0.3, 0.0], atol=0.15)
    np.testing.assert_allclose(second, [0.9, 0.1, 0.0], atol=0.15)


@pytest.mark.slow
def test_a_high_temperature_clones():
    prices = dict.fromkeys(("temperature", "end_temperature"), 1e3)
    cold = OfflineDialHyperparameters(learning_rate=1e-2, **prices)
    dial = train(STATIC, [cold], [two_steps()], chunk=200)["dial"].policy(0)
    found = dial.at(45.0).probabilities(STATES)
    np.testing.assert_allclose(found, [[0.7, 0.3, 0.0], [0.9, 0.1, 0.0]], atol=0.1)


@pytest.mark.slow
def test_a_run_repeats_and_its_record_names_it():
    short = OfflineDialConfig(view="flat", hidden=(8,), updates=20, batch_size=8, members=2)
    runs = [train(short, [NUMBERS], [two_steps(20)], chunk=10)["dial"] for _ in range(2)]
    first, second = (one.policy(0) for one in runs)
    np.testing.assert_array_equal(first.turned.weights[0], second.turned.weights[0])
    assert first.provenance["learner"] == "offline_dial"
    assert OfflineDialHyperparameters(**first.provenance["numbers"]) == NUMBERS
    assert runs[0].history.updates == [10, 20]


def test_high_angles_are_drawn_more_often_where_the_range_has_them():
    """Two in five beyond 77 degrees; of a range that ends at 60, all alike."""
    for static, share in ((OfflineDialConfig(), 0.4), (OfflineDialConfig(high=60.0), 0.0)):
        drawn = draw_directions(jax.random.key(0), 20_000, static.without_idle_share)
        angles = np.rad2deg(np.arctan2(drawn.social, drawn.env))
        assert (angles > 77.0).mean() == pytest.approx(share, abs=0.02)
        assert angles.min() < static.low < static.high < angles.max()


def test_the_critics_take_more_steps():
    short = OfflineDialConfig(view="flat", hidden=(8,), updates=10, critic_factor=3, batch_size=8)
    stages = train(short, [NUMBERS], [two_steps(20)], chunk=10)
    assert [stages[name].history.updates[-1] for name in STAGES] == [10, 30, 10]


def test_times_and_units_are_those_of_the_episodes():
    """Two steps of an episode: times 0 and 1/2, then 1/2 and 1."""
    rows, unit = recorded(two_steps(50))
    np.testing.assert_allclose(rows.time, np.tile([0.0, 0.5], 50))
    np.testing.assert_allclose(rows.next_time, np.tile([0.5, 1.0], 50))
    np.testing.assert_array_equal(rows.ended, np.tile([False, True], 50))
    to_go = np.stack(two_steps(50).returns("to_go", 1.0))
    np.testing.assert_allclose(unit, to_go.std(axis=1), rtol=1e-5)


def test_a_view_that_ends_is_no_end_of_an_episode():
    """Episodes of two steps that time out: of two decisions in all, or of four."""
    data = two_steps(3, Ending.TIMEOUT)
    ended, _ = recorded(data, 2)
    cut, _ = recorded(data, 4)
    assert np.asarray(ended.ended).tolist() == [False, True] * 3
    assert not np.asarray(cut.ended).any()
    assert np.asarray(cut.next_time).tolist() == [0.25, 0.5] * 3
    with pytest.raises(UserError, match="2 decisions, more than a whole one: 1"):
        recorded(data, 1)


@pytest.mark.slow
def test_runs_trained_together_learn_from_their_own_data():
    """As if trained alone; the second one's drivers take action 1 throughout."""
    short = dataclasses.replace(STATIC, updates=100)
    mixed, sure = two_steps(40), two_steps(200)
    sure = sure.select(np.flatnonzero(sure.action[::2] + sure.action[1::2] == 2))
    runs = [NUMBERS, dataclasses.replace(NUMBERS, seed=1)]
    both = train(short, runs, [mixed, sure], chunk=100)["dial"]
    found = [both.policy(run).at(45.0).probabilities(STATES) for run in (0, 1)]
    assert found[1][:, 1].min() > 0.9 > found[0][:, 1].max()
    alone = train(short, runs[1:], [sure], chunk=100)["dial"].policy(0)
    np.testing.assert_allclose(alone.at(45.0).probabilities(STATES), found[1], atol=1e-3)


def test_unlike_data_are_refused():
    wide = dataclasses.replace(two_steps(20), n_actions=4)
    for datasets in ([], [two_steps(20), wide]):
        with pytest.raises(UserError, match="demonstrations"):
            train(STATIC, [NUMBERS] * len(datasets), datasets)


def test_episodes_with_missing_steps_are_refused():
    with pytest.raises(UserError, match="misses steps"):
        train(STATIC, [NUMBERS], [two_steps(20).subsample(2)])


def test_a_stage_that_blows_up_is_told():
    short = OfflineDialConfig(view="flat", hidden=(8,), updates=20, batch_size=8)
    told = r"stage behaviour, seed 0 stopped at update \d+: .* not finite; lower learning_rate$"
    with pytest.raises(UserError, match=told):
        train(short, [OfflineDialHyperparameters(learning_rate=1e30)], [two_steps(20)])


@pytest.mark.usefixtures("as_a_user_runs_it")
@pytest.mark.parametrize(
    "make",
    [
        lambda: OfflineDialConfig(low=50.0, high=20.0),
        lambda: OfflineDialConfig(high=400.0),
        lambda: OfflineDialConfig(margin=-1.0),
        lambda: OfflineDialConfig(high_share=2.0),
        lambda: OfflineDialConfig(members=0),
        lambda: OfflineDialConfig(critic_factor=0),
        lambda: OfflineDialConfig(view="round"),
        lambda: OfflineDialConfig(averaging=0.1),
        lambda: OfflineDialConfig(schedule="linear"),
        lambda: OfflineDialConfig(view="flat", input_scale=2.0),
        lambda: OfflineDialHyperparameters(temperature=0.0),
        lambda: OfflineDialHyperparameters(end_temperature=0.0),
        lambda: OfflineDialHyperparameters(discount=1.1),
        lambda: OfflineDialHyperparameters(polyak=0.0),
        lambda: OfflineDialHyperparameters(final_rate=2.0),
        lambda: OfflineDialHyperparameters(seed=-1),
    ],
)
def test_settings_that_make_no_run_are_refused(make):
    with pytest.raises(UserError) as caught:
        make()
    assert "\n" not in str(caught.value)
