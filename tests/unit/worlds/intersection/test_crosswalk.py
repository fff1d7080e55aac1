"""People on foot at the intersection: what changes with them, what they cause and observe."""

from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from socialiq.errors import UserError
from socialiq.evaluation.episodes import episodes_of, on_foot_row
from socialiq.evaluation.shield import shielded
from socialiq.worlds import OLD_IDS
from socialiq.worlds.highway.core.people import HALF_WIDTH
from socialiq.worlds.highway.options import FEATURES
from socialiq.worlds.intersection.core.geometry import BESIDE, MIDDLE, RIDDEN
from socialiq.worlds.intersection.options import CrosswalkOptions
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make
from socialiq.worlds.road_users import FIRST_CODE, GONE, MOVING, RIDES, WAITING

ROWS, VEHICLES = 60, 70  # episodes; numbers of the vehicles' rows
SLOWER, FASTER = 0, 2


def driven(world, decisions=9, action=None, auto_reset=True):
    """Yield the batch and the results of decisions that are drawn, or all one action."""
    batch, rng = world.batch(ROWS), np.random.default_rng(1)
    batch.reset(500)
    for _ in range(decisions):
        actions = rng.integers(3, size=ROWS) if action is None else np.full(ROWS, action)
        yield batch, batch.step(actions, auto_reset, batch.running)


@pytest.mark.parametrize("suffix", ["", "-caused"])
def test_without_arrivals_the_world_is_the_intersection_to_the_last_bit(suffix):
    plain = make("intersection" + suffix)
    empty = make(f"intersection-crosswalk{suffix}", pedestrian_rate=0.0, class_angle=0.0)
    for (mine, results), (theirs, expected) in zip(driven(empty), driven(plain), strict=True):
        for name in ("env", "social"):
            np.testing.assert_array_equal(
                getattr(results.rewards, name), getattr(expected.rewards, name)
            )
        vehicles = theirs.buffers.vehicles
        for name in vehicles.dtype.names:
            mine_too = mine.buffers.vehicles[name][:, : vehicles.shape[1]]
            np.testing.assert_array_equal(mine_too, vehicles[name])
        np.testing.assert_array_equal(results.observation[:, :VEHICLES], expected.observation)
        assert not results.observation[:, VEHICLES:].any()


def test_people_come_from_a_stream_of_their_own():
    """Traffic begins as without them, and more people don't change who comes first."""
    first = [make("intersection-crosswalk", pedestrian_rate=rate) for rate in (0.05, 0.2)]
    begun = [world.batch(ROWS) for world in (make("intersection"), *first)]
    observed = [batch.reset(500)[:, :VEHICLES] for batch in begun]
    np.testing.assert_array_equal(observed[0], observed[1])
    few, many = (batch.buffers.people for batch in begun[1:])
    np.testing.assert_array_equal(few["way"][:, :5], many["way"][:, :5])
    np.testing.assert_allclose(few["arrival"][:, :5], 4 * many["arrival"][:, :5], rtol=1e-12)
    rate = 1 / np.diff(few["arrival"], axis=1).mean()
    assert rate == pytest.approx(4 * 0.05, rel=0.1)


def test_people_walk_at_their_pace_and_wait_at_the_kerb():
    world, walked = make("intersection-crosswalk", pedestrian_rate=0.5), 0
    for batch, _ in driven(world, action=SLOWER, auto_reset=False):
        records = batch.buffers.people
        there = np.isin(records["state"], (WAITING, MOVING))
        pose = np.sort(np.abs([records["x"][there], records["y"][there]]), axis=0)
        assert np.all(pose[1] == MIDDLE)
        assert np.all(pose[0] <= 5.0 + 1e-9)
        moving = there & (records["speed"] > 0)
        assert np.all(records["speed"][moving] == records["free_speed"][moving])
        walked += int((records["state"] == GONE).sum())
    assert walked > ROWS


def test_nobody_waits_for_an_ego_that_is_far_away():
    world = make("intersection-crosswalk", pedestrian_rate=0.5)
    batch = world.batch(ROWS)
    batch.reset(500)
    ego = np.arange(ROWS), batch.buffers.episodes["controlled"][:, 0]
    for name, value in {"x": 9000.0, "y": 9000.0, "speed": 0.0, "target_speed": 0.0}.items():
        batch.buffers.vehicles[name][ego] = value
    for _ in range(8):
        made = batch.step(np.full(ROWS, SLOWER), auto_reset=False)
        for name in world.options.signals:
            assert not made.signals[name].any()


def crossing(distance, action, speed=9.0):
    """Return the signals of two decisions of an ego before one person in the middle of its lane.

    There are no other vehicles; the ego begins so many metres before the crosswalk.
    """
    world = make("intersection-crosswalk", pedestrian_rate=0.2, spawn_probability=0.0)
    batch = world.with_parts().batch(1)
    batch.reset(3)
    records, vehicles = batch.buffers.people, batch.buffers.vehicles
    slot = batch.buffers.episodes["controlled"][0, 0]
    vehicles[0, 0] = vehicles[0, slot]
    batch.buffers.episodes["vehicles"], batch.buffers.episodes["controlled"][0, 0] = 1, 0
    ego = {"x": 2.0, "y": MIDDLE + HALF_WIDTH + 2.5 + distance, "speed": speed}
    for name, value in {**ego, "target_speed": speed}.items():
        vehicles[name][0, 0] = value
    records["state"] = GONE
    person = {"state": MOVING, "way": 1, "x": 1.8, "y": MIDDLE}
    for name, value in {**person, "free_speed": 1.0, "along_x": 1.0, "along_y": 0.0}.items():
        records[name][0, 0] = value
    made = [batch.step(np.array([action]), auto_reset=False)]
    if made[0].ending[0] == 0:
        made.append(batch.step(np.array([action]), auto_reset=False))
    return made


def test_an_ego_hits_who_walks_before_it_unless_it_brakes():
    hit = crossing(6.0, FASTER)[-1]
    assert (hit.ending[0], hit.contact[0], hit.signals["pedestrian_hit"][0]) == (2, 1, 1.0)
    options = CrosswalkOptions()
    assert hit.rewards.env[0] == options.collision_weight + options.pedestrian_collision_weight
    vulnerable = hit.rewards.social.vulnerable[0]
    closest = options.pedestrian_encounter_weight
    assert vulnerable == pytest.approx(options.pedestrian_hit_weight + closest, abs=0.5)
    assert not any(made.signals["pedestrian_hit"][0] for made in crossing(12.0, SLOWER))
    assert crossing(12.0, FASTER)[0].signals["pedestrian_encounter"][0] > 0.3


def test_who_waits_for_the_ego_alone_is_delayed_by_it():
    """A person at the kerb waits as long as the ego is less than the accepted gap away."""
    batch = alone("intersection-crosswalk", pedestrian_rate=0.2)
    records, vehicles = batch.buffers.people, batch.buffers.vehicles
    ahead = 9.0 * 3.0  # 3 s; the person accepts 4.5 s at first
    vehicles["x"][0, 0], vehicles["y"][0, 0] = 2.0, MIDDLE + HALF_WIDTH + 2.5 + ahead
    vehicles["speed"][0, 0] = vehicles["target_speed"][0, 0] = 9.0
    state = {"state": WAITING, "way": 1, "accepted_gap": 4.5}
    for name, value in {
        **state,
        "along_x": 1.0,
        "along_y": 0.0,
        "x": -5.0,
        "y": MIDDLE,
        "waited": 0.0,
    }.items():
        records[name][0, 0] = value
    made = batch.step(np.array([FASTER]), auto_reset=False)
    assert made.signals["pedestrian_delay"][0] == pytest.approx(1.0)
    options = batch.options
    weight = np.sin(np.deg2rad(options.class_angle)) * options.pedestrian_delay_weight
    assert made.rewards.social[0] == pytest.approx(weight)


@pytest.mark.parametrize("walk", [0.4, 0.0])
def test_drivers_brake_for_who_walks_and_who_rides(walk):
    """Traffic overlaps hardly any person: of 60 episodes with many people, overlaps are counted."""
    rates = {"pedestrian_rate": walk, "cyclist_rate": 0.4 - walk}
    world, over, counted = make("intersection-crosswalk", **rates), 0, 0
    for batch, _ in driven(world, 12, SLOWER, auto_reset=False):
        records, vehicles = batch.buffers.people, batch.buffers.vehicles
        for row in np.flatnonzero(batch.running):
            cars = vehicles[row, : batch.buffers.episodes["vehicles"][row]]
            cars = cars[(cars["agent"] < 0) & (np.abs(cars["speed"]) > 0.5)]
            walking = records[row][records[row]["state"] == MOVING]
            dx = walking["x"][:, None] - cars["x"]
            dy = walking["y"][:, None] - cars["y"]
            along = np.abs(dx * cars["along_x"] + dy * cars["along_y"])
            aside = np.abs(dy * cars["along_x"] - dx * cars["along_y"])
            over += int(((along < 2.5) & (aside < 1.0)).sum())
            counted += len(walking)
    assert counted > 500
    assert over <= 0.01 * counted


def alone(name, **options):
    """Return a batch of one episode with the ego in slot 0, no other vehicle and no person yet."""
    batch = make(name, spawn_probability=0.0, **options).batch(1)
    batch.reset(3)
    vehicles = batch.buffers.vehicles
    vehicles[0, 0] = vehicles[0, batch.buffers.episodes["controlled"][0, 0]]
    batch.buffers.episodes["vehicles"], batch.buffers.episodes["controlled"][0, 0] = 1, 0
    batch.buffers.people["state"] = GONE
    return batch


def placed(batch, x, y, speed, rider):
    """Place the ego before its stop line and the first cyclist on its way, by fields."""
    ego = {"x": x, "y": y, "speed": speed, "target_speed": speed}
    for name, value in ego.items():
        batch.buffers.vehicles[name][0, 0] = value
    people = batch.buffers.people[0]
    number = np.flatnonzero(people["motion"] == RIDES)[0]
    for name, value in rider.items():
        people[name][number] = value
    return people[number : number + 1]


ONCOMING = {"way": 10, "x": -BESIDE, "along_x": 0.0, "along_y": 1.0, "free_speed": 5.0}
"""A cyclist from the north, whose way the left turn of an ego from the south crosses."""


def test_a_cyclist_rides_along_its_lane_and_is_not_held_by_an_ego_that_is_far_away():
    batch = alone("intersection-crosswalk-bicycles")
    state = {"state": WAITING, "y": -RIDDEN, "speed": 5.0, "accepted_gap": 4.0}
    rider = placed(batch, 2.0, 9000.0, 0.0, ONCOMING | state)
    for decision in range(1, 12):
        made = batch.step(np.array([SLOWER]), auto_reset=False)
        assert rider["y"][0] == pytest.approx(-RIDDEN + 5.0 * decision)
        assert not any(made.signals[name][0] for name in batch.options.signals)
    batch.step(np.array([SLOWER]), auto_reset=False)
    batch.step(np.array([SLOWER]), auto_reset=False)
    assert (rider["state"][0], rider["x"][0]) == (GONE, -BESIDE)


def test_a_cyclist_waits_at_its_line_for_the_ego_alone_and_loses_time_by_it():
    batch = alone("intersection-crosswalk-bicycles")
    state = {"state": WAITING, "y": -16.0, "speed": 5.0, "accepted_gap": 4.0, "waited": 0.0}
    rider = placed(batch, 2.0, 25.0, 9.0, ONCOMING | state)
    made = batch.step(np.array([FASTER]), auto_reset=False)
    assert -16.0 < rider["y"][0] <= -11.0
    assert 0.1 < made.signals["cyclist_delay"][0] < 1.0
    assert made.signals["cyclist_braking"][0] == pytest.approx(5.0 - rider["speed"][0])
    weights = {name: getattr(batch.options, f"{name}_weight") for name in batch.options.signals}
    worth = sum(weight * made.signals[name][0] for name, weight in weights.items())
    share = np.sin(np.deg2rad(batch.options.class_angle))
    assert made.rewards.social[0] == pytest.approx(share * worth)
    for _ in range(4):
        batch.step(np.array([FASTER]), auto_reset=False)
    assert (rider["state"][0], rider["speed"][0] > 0) == (MOVING, True)


@pytest.mark.parametrize("hits", [True, False])
def test_an_ego_that_turns_hits_who_rides_across_its_way_unless_it_waits(hits):
    batch = alone("intersection-crosswalk-bicycles")
    state = {"state": MOVING, "y": -7.0, "speed": 5.0, "hit": False, "identity": 10_050}
    placed(batch, 2.0, 16.0, 9.0 if hits else 0.0, ONCOMING | state)
    near = [batch.step(np.array([FASTER if hits else SLOWER]), auto_reset=False)]
    if near[0].ending[0] == 0:
        near.append(batch.step(np.array([FASTER if hits else SLOWER]), auto_reset=False))
    assert near[-1].signals["cyclist_hit"][0] == hits
    assert (near[-1].ending[0] == 2) == hits
    options = batch.options
    if hits:
        cost = options.collision_weight + options.cyclist_collision_weight
        assert near[-1].rewards.env[0] == cost


def test_cyclists_keep_behind_each_other():
    """By the middles of riders that have entered on the same arm, each decision of dense riding."""
    options = CrosswalkOptions(pedestrian_rate=0.0, cyclist_rate=0.4)
    batch = Intersection(options).batch(30)
    batch.reset(np.arange(30))
    gaps = []
    for _ in range(15):
        batch.step(np.zeros(30, np.int64), auto_reset=False, rows=batch.running)
        riders = batch.save().people
        there = np.isin(riders["state"], (WAITING, MOVING))
        along = riders["along_x"] * riders["x"] + riders["along_y"] * riders["y"]
        place = np.where(there, 1000.0 * riders["way"] + along, np.nan)
        near = np.diff(np.sort(place, axis=1), axis=1)
        gaps.append(near[near < 100.0])
    gaps = np.concatenate(gaps)
    assert len(gaps) > 300
    assert (gaps < 1.7).mean() < 0.01


def test_cyclists_have_rows_of_their_own_that_older_policies_do_not_see():
    world, walked = make("intersection-crosswalk-bicycles"), make("intersection-crosswalk")
    rows, known = 0, walked.n_features
    for (batch, made), (plain, _) in zip(driven(world, 1), driven(walked, 1), strict=True):
        on_foot = plain.buffers.people["arrival"]
        count = on_foot.shape[1]
        np.testing.assert_array_equal(batch.buffers.people["arrival"][:, :count], on_foot)
        riding = made.observation[:, known:].reshape(ROWS, -1, len(FEATURES))
        assert riding.shape[1] == world.options.observed_cyclists
        assert set(np.unique(riding[..., 0])) <= {0.0, 3.0}
        rows += int((riding[..., 0] > 0).sum())
        for length in (known + 1, VEHICLES + 1, world.n_features):
            shown = batch.seen_by(SimpleNamespace(n_features=length))
            assert shown.shape == (ROWS, length)
            width = min(length, made.observation.shape[1]) // len(FEATURES) * len(FEATURES)
            np.testing.assert_array_equal(shown[:, :width], made.observation[:, :width])
    assert rows > 0
    assert set(world.reward["vulnerable"]) == set(world.options.signals)
    assert "cyclist_hit" not in walked.reward["vulnerable"]


def test_the_nearest_people_follow_the_vehicles_in_an_observation():
    world = make("intersection-crosswalk", pedestrian_rate=0.3)
    seen = 0
    for _, made in driven(world):
        rows = made.observation.reshape(ROWS, -1, len(FEATURES))
        on_foot = rows[:, VEHICLES // len(FEATURES) :]
        assert set(np.unique(rows[:, : VEHICLES // len(FEATURES), 0])) <= {0.0, 1.0}
        assert set(np.unique(on_foot[..., 0])) <= {0.0, 2.0}
        apart = np.hypot(*(on_foot[..., name] - rows[:, :1, name] for name in (1, 2)))
        apart = np.where(on_foot[..., 0] > 0, apart, np.inf)
        with np.errstate(invalid="ignore"):
            assert not (np.diff(apart, axis=1) < -1e-6).any()
        seen += int((on_foot[..., 0] > 0).sum())
    assert seen > ROWS


def test_copies_of_a_state_meet_the_same_people():
    world = make("intersection-crosswalk-caused", pedestrian_rate=0.3)
    *_, (batch, _) = driven(world, 4, auto_reset=False)
    copies = batch.branch(np.arange(ROWS))
    for _ in range(4):
        rows = batch.running
        mine = batch.step(np.full(ROWS, FASTER), False, rows)
        theirs = copies.step(np.full(ROWS, FASTER), False, rows)
        np.testing.assert_array_equal(mine.observation, theirs.observation)
        np.testing.assert_array_equal(mine.rewards.social, theirs.rewards.social)


def test_rules_see_vehicles_alone_and_metrics_have_the_people():
    world = make("intersection-crosswalk-90", pedestrian_rate=0.2)
    episodes = episodes_of(world.batch(64), world.driver("gap_3s"), range(64))
    row = on_foot_row(episodes)
    assert row["pedestrian_delay"] > 1.0
    assert 0.0 < row["pedestrian_hit_low"] < row["pedestrian_hit"] < 0.5
    assert (
        on_foot_row(episodes_of(make("intersection").batch(4), world.driver("go"), range(4))) == {}
    )


def test_a_shield_keeps_a_rule_from_hitting_people():
    world, seeds = make("intersection-crosswalk", pedestrian_rate=0.2), range(300)
    hits = []
    for seconds in (0.0, 2.0):
        batch = world.batch(300)
        policy = shielded(world.driver("gap_3s"), batch, seconds)
        hits.append(on_foot_row(episodes_of(batch, policy, seeds))["pedestrian_hit"])
    assert hits[0] > 0.05
    assert hits[1] < 0.02
    plain = make("intersection")
    with pytest.raises(UserError, match="crosswalks"):
        shielded(plain.driver("go"), plain.batch(1), 2.0)
    with pytest.raises(UserError, match="positive"):
        shielded(world.driver("go"), world.batch(1), -1.0)


def test_the_environment_is_the_world_with_its_options():
    options = {"pedestrian_rate": 0.3, "class_angle": 90.0}
    env = gymnasium.make(OLD_IDS["intersection-crosswalk"], **options)
    check_env(env.unwrapped, skip_render_check=True)
    batch = make("intersection-crosswalk", **options).batch(1)
    observation, _ = env.reset(seed=3)
    np.testing.assert_array_equal(observation, batch.reset([3])[0])
    seen = set()
    for _ in range(6):
        observation, _, _, _, info = env.step(FASTER)
        decisions = batch.step([FASTER], auto_reset=False)
        np.testing.assert_array_equal(observation, decisions.observation[0])
        assert info["reward_pair"][1] == decisions.rewards.social[0]
        assert env.observation_space.contains(observation)
        seen |= set(observation[:: len(FEATURES)].tolist())
    assert FIRST_CODE in seen


def test_a_value_that_no_world_has_is_refused():
    for option, value in {"pedestrian_rate": 1.5, "walking_speed": 0.0, "impatience": -1.0}.items():
        with pytest.raises(UserError, match=option):
            make("intersection-crosswalk", **{option: value})
    with pytest.raises(UserError, match="class angle"):
        make("intersection-crosswalk", class_angle=100.0)
    with pytest.raises(UserError, match="one class"):
        make("intersection").with_parts()
