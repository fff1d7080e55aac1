"""The observation along the route at a recorded junction."""

import json

import numpy as np
import pytest

import socialiq
from socialiq.cli.main import main
from socialiq.worlds.highway.observation import EGO, LAYOUT, N_FEATURES, USER, USERS, names_of


@pytest.fixture(name="route")
def route_world(world_file):
    return socialiq.world(f"{world_file},observation=route")


def columns(observation):
    ego = dict(zip(names_of(EGO), observation[:, : LAYOUT[0]].T, strict=True))
    users = observation[:, LAYOUT[0] :].reshape(len(observation), USERS, LAYOUT[1])
    return ego, dict(zip(names_of(USER), np.moveaxis(users, -1, 0), strict=True))


def test_it_is_that_of_every_road(route, world):
    assert route.schema == "route-1" and route.n_features == N_FEATURES
    assert route.description != world.description
    batch = route.batch(3)
    assert batch.reset(seeds=0).shape == (3, N_FEATURES)


def test_metres_and_speeds_are_those_of_the_vehicles(route):
    """The junction is a place at 0 of the ego's way; its speed is that of its record."""
    batch = route.batch(6)
    batch.reset(seeds=0)
    for action in (1, 2, 0):
        batch.step(np.full(6, action), auto_reset=False, rows=batch.running)
        ego, users = columns(batch.observation)
        controlled = batch.buffers.episodes["controlled"][:, 0]
        vehicles = batch.buffers.vehicles[np.arange(6), controlled]
        np.testing.assert_allclose(ego["speed"], vehicles["speed"] / 10, atol=1e-5)
        to_conflict = batch.world.road.origin[vehicles["way"]] - vehicles["along"]
        near = np.abs(to_conflict) < 60
        np.testing.assert_allclose(60 * ego["to_conflict_60"][near], to_conflict[near], atol=1e-3)
        np.testing.assert_allclose(ego["beside"], 0.0, atol=1e-5)
        others = batch.buffers.episodes["vehicles"] - 1
        assert (users["presence"].sum(axis=1) >= np.minimum(others, 1)).all()


def test_faults_and_the_front_end_stand_before_it(world_file):
    plain, unseen = (
        socialiq.world(f"{world_file},observation=route{fault}").batch(4)
        for fault in ("", ",unseen=1")
    )
    plain.reset(seeds=0)
    unseen.reset(seeds=0)
    assert columns(plain.observation)[1]["presence"].any()
    assert not columns(unseen.observation)[1]["presence"].any()
    behind = socialiq.world(f"{world_file},observation=route,front_end=[latency=1]").batch(4)
    assert behind.reset(seeds=0).shape == (4, N_FEATURES)


def test_along_the_route_its_actions_are_those_of_every_road(world_file, route):
    rows = socialiq.world(str(world_file))
    assert len(rows.levels) == rows.n_actions == 6
    assert route.levels == (min(rows.levels), 0.0, max(rows.levels), 0.0, 0.0)
    batch = route.batch(5)
    batch.reset(seeds=np.full(5, 3))
    batch.step(np.arange(5))
    cars = batch.buffers.vehicles[np.arange(5), batch.buffers.episodes["controlled"][:, 0]]
    slower, idle, faster, *lanes = (cars["speed"] - cars["before"]).tolist()
    assert slower < 0.0 == idle < faster
    assert lanes == [0.0, 0.0]
    assert route.driver("go").action == 2 and route.driver("wait").action == 0


def test_the_driver_that_ships_drives_there_and_driver_without_an_angle_is_the_rule(
    world_file, capsys
):
    words = ["--episodes", "12", "--json"]
    assert main(["evaluate", "driver@45", "--world", str(world_file), *words]) == 0
    evaluated = json.loads(capsys.readouterr().out)
    policies = ["--policy", "driver@45", "--policy", "driver"]
    assert main(["effects", str(world_file), *policies, *words]) == 0
    network, rule = json.loads(capsys.readouterr().out)["drivers"]
    assert evaluated["r_env"] == pytest.approx(network["r_env"])
    assert network["r_env"] != rule["r_env"]
