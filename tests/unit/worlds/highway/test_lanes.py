"""Pictures of roads from their tables: merge, roundabout, and a road that is not in the package."""

import itertools

import gymnasium
import matplotlib.colors
import numpy as np
import pytest

from socialiq.worlds import SCENE_IDS
from socialiq.worlds.gym import RoadEnv
from socialiq.worlds.highway import render, shapes
from socialiq.worlds.highway.network import APPROACH, CONFLICT, EXIT, Lane, Network, arc, straight
from socialiq.worlds.highway.render import episode_scenes, present_scene
from socialiq.worlds.highway.scenes import (
    FASTER,
    IDLE,
    SCENES,
    Scene,
    _roundabout_roads,
    entry,
    road_of,
    sight,
)
from socialiq.worlds.highway.views import LOWEST, WIDEST
from socialiq.worlds.highway.ways import way_of
from socialiq.worlds.highway.world import world_of
from socialiq.worlds.pictures import EGO, pixels


class Always:
    """Policy of one action."""

    n_features = 35

    def __init__(self, action):
        self.action = action

    def predict(self, observation, deterministic=True):
        return np.full(len(observation), self.action), None


def begun(name, seed=3, traced=False):
    world = world_of(name)
    batch = world.batch(1, traced=traced)
    batch.reset([seed])
    return world, batch


def drawn(axes, figure, x, y):
    """Colour at a place of the world."""
    image = pixels(figure)
    column, row = axes.transData.transform((x, y))
    return matplotlib.colors.to_hex(image[round(image.shape[0] - row), round(column)] / 255)


def strip_of(world, ego_x=None):
    """Picture of the ego alone."""
    batch = world.batch(1)
    batch.reset([3])
    made = present_scene(batch)
    made = made._replace(vehicles=made.vehicles[[made.ego]], ego=0)
    if ego_x is not None:
        made.vehicles["x"] = ego_x
    figure = render.filmstrip([made], world.view)
    return figure, figure.axes[0]


def bend():
    """A road of one lane whose bend is where ways meet."""
    roads = Network()
    roads.add("a", "b", Lane(straight((0.0, 0.0), (60.0, 0.0)), APPROACH))
    roads.add("b", "c", Lane(arc((60.0, 20.0), 20.0, -np.pi / 2, 0.0, 1), CONFLICT))
    roads.add("c", "d", Lane(straight((80.0, 20.0), (80.0, 90.0)), EXIT))
    scales = sight(100.0, 100.0, 20.0, 20.0, 30.0, relative=False)
    road = road_of(roads, scales, [entry(0, 20.0, 8.0)], task=["a", "b", "c", "d"])
    return Scene("bend", road, {})


@pytest.mark.parametrize("name", SCENES)
def test_lanes_are_asphalt_and_the_rest_is_grass(name):
    figure, axes = strip_of(world_of(name))
    frame = axes.get_xlim(), axes.get_ylim()[::-1]
    places = {"merge": [(70.0, 0.0), (40.0, 14.5)], "roundabout": [(-20.0, 0.0), (50.0, 2.0)]}
    places["two_way"] = []  # the influence zone tints the whole road
    for x, y in places[name]:
        assert frame[0][0] < x < frame[0][1] and frame[1][0] < y < frame[1][1]
        assert drawn(axes, figure, x, y) == shapes.ASPHALT
    beside = {"merge": (70.0, -8.0), "roundabout": (0.0, 0.0), "two_way": (40.0, -8.0)}
    assert drawn(axes, figure, *beside[name]) == shapes.GRASS


def test_lines_lie_between_lanes_alone():
    view = world_of("merge").view
    np.testing.assert_allclose(view._beside(1)[:, 1], 2.0)
    assert np.isnan(view._beside(0)).all()
    arms = world_of("roundabout").view._beside(_roundabout_roads().lane("ser", "ses", 0))
    np.testing.assert_allclose(arms[:, 0], 0.0, atol=1e-9)  # the way out lies there


def test_the_frame_follows_the_ego_where_the_road_is_long():
    world, batch = begun("merge", traced=True)
    made = episode_scenes(batch, Always(IDLE), 3)
    frames = [world.view.frame(one) for one in made]
    assert {round(one.east - one.west, 6) for one in frames} == {WIDEST}
    assert len({(one.north, one.south) for one in frames}) == 1
    assert frames[0].south - frames[0].north >= LOWEST
    for one, frame in zip(made, frames, strict=True):
        assert frame.west < one.vehicles["x"][one.ego] < frame.east
    assert frames[-1].west > frames[0].west + 50.0


def test_the_frame_stands_still_where_the_ways_meet():
    world, batch = begun("roundabout", traced=True)
    made = episode_scenes(batch, Always(FASTER), 3)
    frames = {world.view.frame(one) for one in made}
    assert len(frames) == 1 and len(made) > 15
    (frame,) = frames
    assert frame.ratio == 1.0 and frame.west == -frame.east


def test_the_way_of_the_motorway_keeps_the_ego_s_lane():
    _, batch = begun("merge")
    ego = batch.buffers.vehicles[0, 0].copy()
    for number in (0, 1):
        ego["target_lane"] = number
        assert way_of(ego, batch.scene.road) == [number, 2 + number, 5 + number]


def test_the_way_round_enters_by_the_outer_lane_and_goes_on_along_the_ego_s():
    _, batch = begun("roundabout")
    roads, ego = _roundabout_roads(), batch.buffers.vehicles[0, 0].copy()
    nodes = ["ser", "ses", "se", "ex", "ee", "nx", "nxs"]
    outer = [0, 0, 1, 1, 1, 0]
    pairs = list(itertools.pairwise(nodes))
    way = [roads.lane(*pair, number) for pair, number in zip(pairs, outer, strict=True)]
    assert way_of(ego, batch.scene.road)[: len(way)] == way
    ego["target_lane"] = roads.lane("ex", "ee", 0)
    way[3:5] = roads.lane("ex", "ee", 0), roads.lane("ee", "nx", 0)
    assert way_of(ego, batch.scene.road)[: len(way)] == way


def test_the_way_ends_at_the_place_of_arrival():
    for name, end in (("merge", (370.0, 4.0)), ("roundabout", (2.0, None))):
        world, batch = begun(name)
        line = np.concatenate(
            world.view._to_arrival(way_of(batch.buffers.vehicles[0, 0], batch.scene.road))
        )
        assert line[-1, 0] == pytest.approx(end[0], abs=1.0)
        assert end[1] is None or line[-1, 1] == end[1]
        assert np.hypot(*np.diff(line, axis=0).T).max() < 6.0  # highway-env's do not join


def test_the_obstacle_is_drawn_and_explained():
    world = world_of("merge")
    assert world.view.marks == ("obstacle",) and world_of("roundabout").view.marks == ()
    ((x, y),) = world.scene.road.obstacles
    figure, axes = strip_of(world, ego_x=290.0)
    red, green, blue = matplotlib.colors.to_rgb(drawn(axes, figure, x - 0.8, y))
    assert red > 0.8 and max(green, blue) < 0.3
    assert drawn(axes, figure, x - 8.0, y) == shapes.ASPHALT


@pytest.mark.parametrize("name", SCENES)
def test_gymnasium_renders(name):
    env = gymnasium.make(SCENE_IDS[name], render_mode="rgb_array")
    env.reset(seed=3)
    before = env.render()
    assert before.shape[1] == 600 and before.shape[0] % 2 == 0
    color = np.rint(255 * np.array(matplotlib.colors.to_rgb(EGO)))
    assert (before == color).all(axis=-1).sum() > 30
    env.step(IDLE)
    assert not np.array_equal(before, env.render())
    assert gymnasium.make(SCENE_IDS[name]).unwrapped.render() is None


def test_a_road_of_one_s_own_needs_nothing_new():
    env = RoadEnv(bend(), render_mode="rgb_array")
    env.reset(seed=0)
    assert env.render().shape[1] == 600
    figure, axes = strip_of(world_of(bend()))
    assert drawn(axes, figure, 10.0, 0.0) == shapes.ASPHALT
    assert drawn(axes, figure, 10.0, 20.0) == shapes.GRASS
