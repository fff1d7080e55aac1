"""Known answers of what the ego causes, on every compiled road."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds.highway.core import effects as core
from socialiq.worlds.highway.core.compile import for_python
from socialiq.worlds.highway.effects import BEGIN, REPEAT, SIGNALS, EffectOptions
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import open_world

SLOW = [pytest.param(road, marks=pytest.mark.slow) for road in ("merge", "roundabout")]
ROADS = pytest.mark.parametrize("road", ["intersection", *SLOW])
EPISODES = 60


def started(road, size=EPISODES, **options):
    batch = open_world(f"{road}-caused", **options).batch(size)
    batch.reset(seeds=np.arange(7_000_000, 7_000_000 + size))
    return batch


def driven(batch, choose):
    """Drive to the end by `choose(decision)`; return the sums of the signals and the endings."""
    running, sums = np.ones(batch.size, bool), np.zeros((batch.size, len(SIGNALS)))
    ending, decision = np.zeros(batch.size, int), 0
    while running.any():
        decisions = batch.step(choose(decision), auto_reset=False, rows=running)
        signals = np.stack([decisions.signals[name] for name in SIGNALS], axis=1)
        sums[running] += signals[running]
        ending[running] = decisions.ending[running]
        running &= decisions.ending == int(Ending.NONE)
        decision += 1
    return sums, ending


def constant(batch, action):
    return lambda _: np.full(batch.size, action)


@ROADS
def test_an_ego_far_away_causes_nothing(road):
    batch = started(road)
    state, rows = batch.save(), np.arange(batch.size)
    ego = state.episodes["controlled"][:, 0]
    for name, value in {"x": 9000.0, "y": 9000.0, "speed": 0.0, "target_speed": 0.0}.items():
        state.vehicles[name][rows, ego] = value
    batch.restore(state)
    sums, _ = driven(batch, constant(batch, 1))
    assert np.abs(sums[:, 0]).max() < 1e-9  # of some thousand metres
    assert not sums[:, 1:].any()


def test_an_ego_alone_causes_nothing():
    batch = started("intersection", spawn_probability=0.0)
    state, rows = batch.save(), np.arange(batch.size)
    state.vehicles[:, 0] = state.vehicles[rows, state.episodes["controlled"][:, 0]]
    state.episodes["vehicles"], state.episodes["controlled"][:, 0] = 1, 0
    batch.restore(state)
    batch.measure(BEGIN, np.ones(batch.size, bool))
    sums, _ = driven(batch, constant(batch, batch.faster))
    assert not sums.any()


@ROADS
def test_signals_sum_to_the_metres_and_brakings_of_both_worlds(road):
    batch, rng = started(road), np.random.default_rng(0)
    sums, _ = driven(batch, lambda _: rng.integers(0, batch.n_actions, batch.size))
    apart = (batch.ledger.without - batch.ledger.driven).sum(axis=1)
    np.testing.assert_allclose(sums[:, 0], apart[:, 0], atol=1e-8)
    np.testing.assert_array_equal(sums[:, 1], -apart[:, 1])


@ROADS
def test_a_restored_episode_repeats_every_bit_and_its_tail(road):
    batch, rng = started(road, 30), np.random.default_rng(1)
    batch.step(np.full(30, 1), auto_reset=False)
    state = batch.save()
    running = np.flatnonzero(batch.buffers.ending == int(Ending.NONE))
    actions = rng.integers(0, batch.n_actions, (60, len(running)))
    copies = batch.branch(running)
    first = driven(copies, lambda decision: actions[decision])
    batch.restore(state)
    copies = batch.branch(running)
    again = driven(copies, lambda decision: actions[decision])
    assert len(running) > 10
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])


@ROADS
def test_a_look_ahead_with_the_own_action_is_the_step(road):
    batch = started(road)
    for action in range(batch.n_actions):
        state = batch.save()
        batch.measure(REPEAT + action, np.ones(batch.size, bool))
        ahead = batch.ledger.ahead[..., 0].copy()
        batch.step(np.full(batch.size, action), auto_reset=False)
        now, compared = batch.buffers, 0
        for row in range(batch.size):
            ego = now.episodes["controlled"][row, 0]
            for slot in np.delete(np.arange(now.episodes["vehicles"][row]), ego):
                vehicle = now.vehicles[row, slot]
                assert ahead[row, vehicle["identity"]] == vehicle["speed"]
                compared += 1
        assert compared > batch.size
        batch.restore(state)


@pytest.mark.parametrize("action", [0, 2], ids=["wait", "go"])
def test_crude_drivers_cost_others_much(action):
    batch = started("intersection", 300)
    sums, ending = driven(batch, constant(batch, action))
    error = sums[:, 0].std() / len(sums) ** 0.5
    assert sums[:, 0].mean() > 5 * error
    collided = ending == int(Ending.COLLISION)
    if action == 2:  # a crash is not kind either
        assert collided.sum() > 50
        assert sums[collided, 0].mean() > 5 * sums[collided, 0].std() / collided.sum() ** 0.5


@pytest.mark.two_cores
def test_results_depend_on_neither_threads_nor_the_batch():
    alone = started("intersection", 1)
    together = Intersection(effects=EffectOptions()).batch(5, threads=2)
    together.reset(seeds=np.arange(7_000_000, 7_000_005))
    sums, others = driven(alone, constant(alone, 2)), driven(together, constant(together, 2))
    np.testing.assert_array_equal(sums[0][0], others[0][0])


def test_rewards_are_weighted_signals_and_a_new_episode_follows():
    weights = {"delay_weight": -1.0, "braking_weight": -2.0, "encounter_weight": -4.0}
    batch = started("intersection", 40, caused_collision_weight=-8.0, **weights)
    seen_ending = False
    for _ in range(25):
        decisions = batch.step(np.full(40, 2))
        collided = decisions.ending == int(Ending.COLLISION)
        expected = -8.0 * collided
        for name, weight in zip(SIGNALS, weights.values(), strict=True):
            expected = expected + weight * decisions.signals[name]
        np.testing.assert_allclose(decisions.rewards.social, expected, atol=1e-9)
        seen_ending |= bool(collided.any())
    assert seen_ending


def test_wrecks_that_stay_cost_more():
    towed, left = started("intersection", 300), started("intersection", 300, tow_after=0.0)
    costs = [driven(batch, constant(batch, 2))[0][:, 0].mean() for batch in (towed, left)]
    assert costs[1] > costs[0] + 20


def test_a_world_without_effects_has_no_ledger():
    batch = open_world("intersection").batch(2)
    assert batch.ledger is None
    caused = started("intersection", 2)
    with pytest.raises(UserError, match="only one of state and batch measures effects"):
        batch.restore(caused.save())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"horizon": 10.0}, "horizon must be at least the duration of an episode, 20 s"),
        ({"horizon": "long"}, "horizon of intersection is a text"),
        ({"tow_after": -1.0}, "tow_after must be a number of seconds"),
        ({"after_timeout": "flies"}, "after_timeout"),
        ({"delay_weight": float("nan")}, "delay_weight must be a finite number"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(UserError, match=message):
        open_world("intersection-caused", **options).batch(1)


def test_highway_env_has_no_episode_without_its_ego():
    with pytest.raises(UserError, match="highway-env can't drive without its ego"):
        Intersection(effects=EffectOptions()).batch(1, back_end="highway_env")


def test_predicted_gaps_by_hand():
    dtype = [(name, "f8") for name in ("x", "y", "speed", "along_x", "along_y")]
    gap = for_python(core.predicted_gap)

    def of(*ways):
        egos, others = (np.array([way], dtype) for way in ways)
        return gap(egos[0], others[0])

    ego = (0.0, 0.0, 10.0, 1.0, 0.0)  # reaches (20, 0) from 16.5 m, leaves after 23.5 m
    assert of(ego, (20.0, -40.0, 10.0, 0.0, 1.0)) == pytest.approx((1.65, 3.65 - 2.35))
    assert of(ego, (20.0, -20.0, 10.0, 0.0, 1.0)) == pytest.approx((1.65, 0.0))
    assert of(ego, (20.0, 20.0, 10.0, 0.0, 1.0))[1] == np.inf  # it has passed
    assert of(ego, (20.0, 4.0, 10.0, -1.0, 0.0))[1] == np.inf  # the opposite lane
    assert of(ego, (20.0, -40.0, 0.0, 0.0, 1.0))[1] == np.inf  # it stands
