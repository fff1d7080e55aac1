"""Generated roads as worlds: grammar, options, episodes, drivers, capabilities."""

import gymnasium
import numpy as np
import pytest

import socialiq
from socialiq.cli.worlds import options_of
from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds import grammar
from socialiq.worlds.gym import observations_of
from socialiq.worlds.highway.generated import Layout
from socialiq.worlds.highway.render import decision_scenes, present_scene
from socialiq.worlds.highway.views import Lanes
from socialiq.worlds.highway.ways import way_of
from socialiq.worlds.intersection.generated import GeneratedOptions
from socialiq.worlds.intersection.options import EXIT_DISTANCE
from socialiq.worlds.spelled_out import declared

KINDS = {
    (layout.form, layout.arms, layout.enters): seed
    for seed, layout in enumerate(map(Layout.of_seed, range(200)))
}
"""A seed of each shape, number of arms and arm of the ego."""
SAMPLE = (0, 1, 2, 3, 4, 5, 6, 8, 11, 14, 20, 26)
"""Seeds of roads of each shape, number of arms and priority, which are driven."""
EPISODES = 20


def driven(text, driver, episodes=EPISODES):
    """Drive one episode in each row; return endings and returns of r_env, by row."""
    world = grammar.build(text)
    batch = world.batch(episodes)
    batch.reset(0)
    policy = world.driver(driver)
    space = observations_of(world, clock=False)
    endings = np.zeros(episodes, int)
    r_env = np.zeros(episodes)
    while batch.running.any():
        running = batch.running
        observation = batch.observation
        assert (observation >= space.low).all()
        assert (observation <= space.high).all()
        action, _ = policy.predict(observation)
        decisions = batch.step(action, auto_reset=False, rows=running)
        r_env[running] += decisions.rewards.env[running]
        endings[running] = decisions.ending[running]
        assert np.isfinite(decisions.rewards.social).all()
    return endings, r_env


@pytest.mark.parametrize("seed", KINDS.values())
def test_every_road_builds_and_begins(seed):
    world = grammar.build(f"road,seed={seed}")
    batch = world.batch(2)
    observation = batch.reset(0)
    assert observation.shape == (2, world.n_features)
    assert (observation[:, 0] == 1).all()
    ego = batch.buffers.vehicles[0, batch.buffers.episodes["controlled"][0, 0]]
    assert ego["y"] > 40
    assert 0 < ego["x"] < 8
    batch.step(np.full(2, batch.faster))


def test_the_sample_has_every_kind_of_road():
    layouts = [Layout.of_seed(seed) for seed in SAMPLE]
    kinds = {(layout.form, layout.arms) for layout in layouts}
    assert kinds == {(form, arms) for form in ("crossing", "roundabout") for arms in (3, 4, 5)}
    assert {layout.priority for layout in layouts} == {"main", "stop", "none"}
    assert {layout.lanes for layout in layouts} == {1, 2}


@pytest.mark.parametrize("driver", ["gap_3s", "idm"])
@pytest.mark.parametrize("seed", SAMPLE)
def test_a_rule_drives_episodes_of_a_road_to_their_end(seed, driver):
    endings, _ = driven(f"road,seed={seed}", driver)
    assert (endings != int(Ending.NONE)).all()
    assert (endings == int(Ending.ARRIVAL)).sum() >= 5


@pytest.mark.parametrize("seed", SAMPLE)
def test_who_waits_runs_out_of_time_and_who_goes_does_not(seed):
    waiting, r_waiting = driven(f"road,seed={seed}", "wait")
    going, r_going = driven(f"road,seed={seed}", "go")
    assert (waiting == int(Ending.TIMEOUT)).mean() > 0.8
    assert (going == int(Ending.TIMEOUT)).sum() == 0
    assert (going == int(Ending.ARRIVAL)).any()
    assert r_going.mean() > r_waiting.mean() + 5


@pytest.mark.parametrize("exit", ["left", "straight", "right", "random"])
@pytest.mark.parametrize(
    "layout",
    ["shape=crossing,arms=4", "shape=crossing,arms=3,enters=1", "shape=roundabout,arms=5,lanes=2"],
)
def test_progress_is_the_length_of_the_way_to_the_exit(layout, exit):
    text = f"road,seed=3,skew=0,{layout},exit={exit},spawn_probability=0,initial_vehicle_count=1"
    world = grammar.build(text)
    batch = world.batch(4)
    batch.reset(0)
    lanes = world.scene.road.lanes
    slots = batch.buffers.episodes["controlled"][:, 0]
    egos = batch.buffers.vehicles[np.arange(4), slots].copy()
    begin = batch.buffers.episodes["start"][:, 0].copy()
    progress = np.zeros(4)
    endings = np.zeros(4, int)
    while batch.running.any():
        running = batch.running
        action = np.full(4, batch.faster)
        decisions = batch.step(action, auto_reset=False, rows=running)
        progress[running] += decisions.signals["progress"][running] * world.options.progress_unit
        endings[running] = decisions.ending[running]
    for row in np.flatnonzero(endings == int(Ending.ARRIVAL)):
        way = world.scene.road.routes[egos[row]["route"], egos[row]["destination"]]
        whole = lanes["length"][way[way >= 0][:-1]].sum() + EXIT_DISTANCE
        last = world.options.max_speed  # m of the decision in which it arrives
        assert whole - begin[row] - last - 1 < progress[row] < whole - begin[row] + 0.5
    assert (endings == int(Ending.ARRIVAL)).any()


def test_an_exit_is_found_by_the_angle_of_its_way():
    t_from_side = GeneratedOptions(shape="crossing", arms=3, skew=0.0, enters=0)
    assert t_from_side.exits == {"random": 0, "left": 1, "straight": 1, "right": 2}
    t_from_main = GeneratedOptions(shape="crossing", arms=3, skew=0.0, enters=2)
    assert t_from_main.exits["straight"] == 2
    assert GeneratedOptions(arms=4, skew=0.0).exits["straight"] == 2
    five = GeneratedOptions(arms=5, skew=0.0)
    assert five.exits["right"] == 4
    assert five.exits["straight"] in (2, 3)


def test_what_the_text_gives_is_not_drawn():
    drawn = Layout.of_seed(17)
    options = grammar.build("road,seed=17").options
    assert isinstance(options, GeneratedOptions)
    assert options.layout == drawn
    text = "road,arms=3,priority=none,lanes=2,shape=roundabout,skew=20,enters=1"
    given = grammar.build(text).options
    assert isinstance(given, GeneratedOptions)
    assert given.layout == Layout("roundabout", 3, 2, "none", 20.0, 1)


def test_a_declaration_spells_every_property():
    name, options = declared("road,seed=17,arms=3")
    layout = Layout.of_seed(17)
    assert name == "road"
    assert options == {
        "seed": 17, "shape": layout.form, "arms": 3, "lanes": layout.lanes,
        "priority": layout.priority, "skew": layout.skew, "enters": layout.enters % 3,
    }  # fmt: skip
    plain = grammar.build("road,seed=17,arms=3")
    spelled = grammar.build(name, options)
    first = plain.batch(3)
    second = spelled.batch(3)
    np.testing.assert_array_equal(first.reset(0), second.reset(0))
    action = np.ones(3, int)
    np.testing.assert_array_equal(first.step(action).observation, second.step(action).observation)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("road,arms=6", "arms must be a whole number from 3 to 5, got 6"),
        ("road,arms=0", "arms must be a whole number from 3 to 5, got 0"),
        ("road,lanes=3", "lanes must be a whole number from 1 to 2, got 3"),
        ("road,arms=3,enters=3", "enters must be a whole number from 0 to 2, got 3"),
        ("road,skew=45", "skew must lie between -30 and 30 degrees, got 45"),
        ("road,skew=nan", "skew must lie between -30 and 30 degrees, got nan"),
        ("road,seed=-1", "seed must be at least 0, got -1"),
        ("road,shape=square", "unknown shape 'square'"),
        ("road,priority=left", "unknown priority 'left'"),
        ("road,shape=roundabout,cyclists=0.1", "it has no bicycle lanes"),
        ("road,control=continuous", "can't follow a way with bends"),
        ("road,demand=x.rou.xml", "demand is of SUMO"),
        ("road,agents=17", "agents must be at most 16"),
    ],
)
def test_a_mistake_is_refused_in_one_line(text, message):
    with pytest.raises(UserError, match=message) as refusal:
        grammar.build(text)
    assert "\n" not in str(refusal.value)


def test_gymnasium_makes_a_road():
    env = gymnasium.make("socialiq/Road-v1", seed=4, angle=45.0, render_mode="rgb_array")
    observation, _ = env.reset(seed=3)
    assert env.observation_space.contains(observation)
    observation, reward, _, _, info = env.step(2)
    assert env.observation_space.contains(observation)
    assert np.isclose(reward, info["reward_pair"].sum() * np.sqrt(0.5))
    picture = env.render()
    assert isinstance(picture, np.ndarray)
    assert picture.ndim == 3


def test_a_road_has_a_table_of_options():
    rows = {row["key"]: row for row in options_of("road")}
    assert rows["skew"]["meaning"].startswith("degrees")
    assert rows["duration"]["default"] == "30"
    assert "exit, destination" in rows
    assert {"control", "people", "cyclists"} <= {key.split(",")[0] for key in rows}


def test_effects_of_an_ego_are_measured():
    world = grammar.build("road,seed=4,reward=caused")
    batch = world.batch(8)
    batch.reset(0)
    policy = world.driver("go")
    signals = [batch.step(policy.predict(batch.observation)[0]).signals for _ in range(12)]
    assert {"delay", "braking", "encounter"} <= signals[0].keys()
    assert any(np.abs(step["delay"]).max() > 0 for step in signals)


@pytest.mark.parametrize("frame", ["own", "world"])
def test_agents_enter_by_the_arms_in_turn(frame):
    world = grammar.build(f"road,seed=4,agents=5,frame={frame}")
    layout = world.options.layout
    batch = world.batch(3)
    observation = batch.reset(0)
    vehicles = batch.buffers.vehicles
    for row in range(3):
        egos = vehicles[row][batch.buffers.episodes["controlled"][row, :5]]
        assert egos["origin"].tolist() == [agent % layout.arms for agent in range(5)]
        directions = np.array(layout.directions)[egos["origin"]]
        along = egos["x"] * np.cos(directions) + egos["y"] * np.sin(directions)
        assert (along > 40).all()
    own = observation.reshape(3, 5, -1, 7)[:, :, 0]
    heads_north = np.isclose(own[..., 6], -1.0, atol=1e-6).all()
    assert heads_north == (frame == "own")
    for _ in range(5):
        batch.step(np.full((3, 5), batch.faster))


@pytest.mark.parametrize("seed", SAMPLE)
def test_a_picture_shows_the_way_to_the_exit(seed):
    world = grammar.build(f"road,seed={seed}")
    batch = world.batch(1, traced=True)
    batch.reset(0)
    scene = present_scene(batch)
    ego = scene.vehicles[scene.ego]
    way = way_of(ego, world.scene.road)
    route = world.scene.road.routes[ego["route"], ego["destination"]]
    assert way == route[route >= 0].tolist()
    view = world.view
    assert isinstance(view, Lanes)
    frame = view.frame(scene)
    assert frame.west < ego["x"] < frame.east
    batch.step(np.array([batch.faster]))
    assert len(list(decision_scenes(batch))) == world.options.frames


def test_faults_and_a_front_end_wrap_a_road():
    world = grammar.build("road,seed=4,latency=1,unseen=0.3,front_end=[latency=1,track=3]")
    batch = world.batch(4)
    batch.reset(0)
    policy = world.driver("gap_3s")
    for _ in range(10):
        decisions = batch.step(policy.predict(batch.seen_by(policy))[0])
    assert np.isfinite(decisions.observation).all()


def test_the_public_function_makes_a_road():
    assert socialiq.make("road", seed=17, arms=3) == socialiq.make("road,seed=17,arms=3")
