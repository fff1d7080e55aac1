"""Invariants for any seed, any actions, any options."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialiq.types import Ending
from socialiq.worlds.highway.options import ENV_SIGNALS, SIGNALS, SOCIAL_SIGNALS, VEHICLE
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

SCENARIOS = {
    "thesis": Options(population="thesis"),
    "connected": Options(connected_lanes=True, population="thesis"),
    "crowded": Options(spawn_probability=1.0, initial_vehicle_count=12, duration=25.0),
    "fine": Options(simulation_frequency=15, policy_frequency=5, duration=4.5),
    "destinations": Options(destination="random", observed_vehicles=3),
    "canonical": Options(canonical=True, zone="beyond_8_m", crash="add"),
    "fast": Options(target_speeds=(-3.0, 6.0, 15.0), simulation_frequency=2, policy_frequency=1),
}
NUMBERS = [name for name in VEHICLE.names if VEHICLE[name].kind == "f" and name != "desired_speed"]


@cache
def batch_of(name):
    return Intersection(SCENARIOS[name]).batch(1)


def check_numbers(batch, made):
    observation = np.stack([made.observation, batch.observation])
    assert np.isfinite(observation).all() and np.abs(observation).max() <= 1.0
    assert np.isfinite(made.rewards).all() and np.isfinite(made.classical).all()
    assert all(np.isfinite(value).all() for value in made.signals.values())
    count = batch.buffers.episodes["vehicles"][0]
    assert 0 < count <= batch.options.capacity
    vehicles = batch.buffers.vehicles[0, :count]
    for name in NUMBERS:
        assert np.isfinite(vehicles[name]).all()
    assert not np.isnan(vehicles["desired_speed"]).any()
    assert (vehicles["lane"] >= 0).all() and (vehicles["lane"] < 20).all()


@given(
    name=st.sampled_from(sorted(SCENARIOS)),
    seed=st.integers(0, 2**64 - 1),
    actions=st.lists(st.integers(0, 2), max_size=25),
)
@settings(max_examples=80, derandomize=True)
def test_numbers_stay_finite_and_episodes_end(name, seed, actions):
    batch = batch_of(name)
    options = batch.options
    observation = batch.reset([seed])
    assert np.isfinite(observation).all() and np.abs(observation).max() <= 1.0
    decisions = np.ceil(options.duration * options.policy_frequency)
    for number, action in enumerate(actions, start=1):
        made = batch.step([action], auto_reset=False)
        check_numbers(batch, made)
        if made.ending[0]:
            break
        assert number < decisions


@pytest.mark.parametrize("name", sorted(SCENARIOS))
def test_vehicles_fit_their_places_to_the_last_decision(name):
    # the row behind the last place would belong to the next episode
    batch = Intersection(SCENARIOS[name]).batch(8)
    batch.reset(0)
    running = np.ones(8, bool)
    while running.any():
        running &= batch.step(np.zeros(8, int), auto_reset=False, rows=running).ending == 0
        counts = batch.buffers.episodes["vehicles"]
        assert (counts <= batch.options.capacity).all()
        for row, count in enumerate(counts):
            identity = batch.buffers.vehicles["identity"][row, :count]
            assert (np.diff(identity) > 0).all()


WEIGHED = {f"{name}_weight": 0.7 * number - 3.0 for number, name in enumerate(SIGNALS)}
READINGS = [
    {},
    {"crash": "add"},
    *({"zone": zone} for zone in ("last_8_m", "beyond_8_m", "travelled_8_m")),
    *({"counted": counted} for counted in ("cross", "approaching")),
    {"disruption": "literal"},
    WEIGHED,
    {"crash": "add", "zone": "beyond_8_m", "counted": "cross", "disruption": "literal", **WEIGHED},
]


@pytest.mark.parametrize(
    "changes", READINGS, ids=lambda changes: "-".join(list(changes)[:4]) or "thesis"
)
def test_rewards_are_the_weighted_sums_of_their_signals(changes, drive):
    options = Options(spawn_probability=1.0, **changes)
    active = dict.fromkeys(SIGNALS, 0)
    for _, made in drive(options, 48, 40):
        for names, reward in zip((ENV_SIGNALS, SOCIAL_SIGNALS), made.rewards, strict=True):
            weights = {name: getattr(options, f"{name}_weight") for name in names}
            expected = sum(weights[name] * made.signals[name] for name in names)
            np.testing.assert_allclose(reward, expected, rtol=1e-12, atol=1e-12)
        crashed = made.ending == Ending.COLLISION
        np.testing.assert_array_equal(made.signals["collision"], crashed)
        np.testing.assert_array_equal(made.signals["neighbour_collision"], crashed)
        np.testing.assert_array_equal(made.signals["arrival"], made.ending == Ending.ARRIVAL)
        np.testing.assert_array_equal(made.signals["timeout"], made.ending == Ending.TIMEOUT)
        np.testing.assert_array_equal(made.signals["step"], ~np.isin(made.ending, (1, 2)))
        for name in active:
            active[name] += np.count_nonzero(made.signals[name])
        if options.crash == "override":
            assert not made.signals["yielding"][crashed].any()
    assert min(count for name, count in active.items() if name != "timeout") > 0


def test_readings_pay_differently(drive):
    """Each changes r_social of the same episode, and nothing else."""
    paid = []
    for changes in READINGS[:8]:
        runs = list(drive(Options(spawn_probability=1.0, **changes), 48, 40))
        paid.append(np.concatenate([made.rewards.social for _, made in runs]))
        ride = [made.observation.sum() for _, made in runs]
        env = [made.rewards.env.sum() for _, made in runs]
        assert paid[0].shape == paid[-1].shape
        first = (ride, env) if len(paid) == 1 else first
        assert (ride, env) == first
    for one in range(len(paid)):
        for other in range(one):
            assert (paid[one] != paid[other]).any()


def test_who_counts_narrows_from_reading_to_reading(drive):
    yielding = [
        np.concatenate(
            [made.signals["yielding"] for _, made in drive(Options(counted=kind), 48, 40)]
        )
        for kind in ("all", "cross", "approaching")
    ]
    assert (yielding[0] >= yielding[1]).all() and (yielding[1] >= yielding[2]).all()
    assert yielding[0].sum() > yielding[1].sum() > yielding[2].sum() > 0
