"""People on every road: they arrive at its crosswalks, cross it, and change nothing else."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.simulate import play
from socialiq.types import Ending
from socialiq.worlds import grammar
from socialiq.worlds.highway.people import PeopleOptions
from socialiq.worlds.road_users import GONE, MOVING

ROADS = ["merge", "roundabout", "two_way", "road,seed=2", "road,seed=17"]
SEEDS = np.arange(40)


def driven(text, driver="wait"):
    """Drive episodes and return their batch and decisions."""
    world = grammar.build(text)
    batch = world.batch(len(SEEDS))
    return batch, list(play(batch, world.driver(driver, 0), SEEDS))


@pytest.mark.parametrize("road", ROADS)
def test_without_arrivals_vehicles_drive_as_on_the_plain_road(road):
    plain, _ = driven(road, "go")
    walked, _ = driven(f"{road},people=0", "go")
    for name in plain.buffers.vehicles.dtype.names:
        np.testing.assert_array_equal(plain.buffers.vehicles[name], walked.buffers.vehicles[name])


@pytest.mark.parametrize("road", ROADS)
def test_people_cross_and_an_ego_before_a_crosswalk_sees_them(road):
    batch, decisions = driven(f"{road},people=0.3")
    options = batch.options
    assert isinstance(options, PeopleOptions)
    rows = [decision.made.observation for decision in decisions]
    observed = np.concatenate(rows).reshape(-1, options.observed_rows, 7)
    people = observed[:, options.observed_vehicles :, 0]
    assert people.shape[1] == options.observed_pedestrians and (people == 2.0).any()
    assert np.isin(batch.buffers.people["state"], (MOVING, GONE)).any()
    ways = batch.road.crossings.ways[batch.buffers.people["way"]]
    aside = (batch.buffers.people["x"] - ways["x"]) * ways["along_y"]
    aside -= (batch.buffers.people["y"] - ways["y"]) * ways["along_x"]
    assert np.abs(aside).max() < 1e-9


@pytest.mark.parametrize("road", ["roundabout", "road,seed=17"])
def test_an_ego_that_goes_holds_up_people_and_one_that_stands_far_off_does_not(road):
    delays = {
        driver: sum(
            decision.made.signals["pedestrian_delay"].sum()
            for decision in driven(f"{road},people=0.3", driver)[1]
        )
        for driver in ("go", "wait")
    }
    assert delays["go"] > 5 * delays["wait"]


@pytest.mark.parametrize("road", ["roundabout", "two_way"])
def test_people_cross_the_mirror_image_in_the_same_way(road):
    _, decisions = driven(f"{road},people=0.3", "go")
    _, mirrored = driven(f"{road},people=0.3,left_hand=true", "go")
    for decision, image in zip(decisions, mirrored, strict=True):
        np.testing.assert_array_equal(decision.made.ending, image.made.ending)
        delay, of_image = (step.made.signals["pedestrian_delay"] for step in (decision, image))
        np.testing.assert_allclose(delay, of_image, atol=1e-6)


def test_a_road_without_bicycle_lanes_refuses_cyclists():
    with pytest.raises(UserError, match="has no cyclists: it has no bicycle lanes"):
        grammar.build("roundabout,cyclists=0.1")


@pytest.mark.parametrize("road", ["intersection", "road,seed=2"])
def test_each_agent_counts_what_it_does_to_people(road):
    batch = grammar.build(f"{road},people=0.3,agents=3").batch(len(SEEDS))
    batch.reset(SEEDS)
    random = np.random.default_rng(0)
    delays = np.zeros(batch.shape)
    hits = np.zeros(batch.shape, bool)
    while batch.running.any():
        driving = batch.driving
        actions = random.integers(0, batch.n_actions, batch.shape)
        decided = batch.step(actions, auto_reset=False, rows=batch.running)
        hit = (decided.signals["pedestrian_hit"] > 0) & driving
        assert (decided.ending[hit] == int(Ending.COLLISION)).all()
        weights = batch.options.pedestrian_hit_weight * np.sqrt(0.5)
        assert (decided.rewards.social[hit] < 0.9 * weights).all()
        delays += np.where(driving, decided.signals["pedestrian_delay"], 0.0)
        hits |= hit
    assert (delays.sum(axis=0) > 0).all()
    assert hits.any() and not hits.all(axis=1).any()


def test_agents_account_for_more_of_the_waiting_than_one_ego_and_never_for_all():
    """A person is charged to an agent if it would go on without this agent alone."""
    worlds = {
        agents: grammar.build(f"intersection,people=0.3,agents={agents}") for agents in (1, 4)
    }
    delays = {}
    for agents, world in worlds.items():
        batch = world.batch(len(SEEDS))
        batch.reset(SEEDS)
        lost = np.zeros((len(SEEDS), agents))
        waited = batch.buffers.people["waited"].sum()
        for _ in range(6):
            decided = batch.step(
                np.ones(batch.shape, np.int64), auto_reset=False, rows=batch.running
            )
            lost += decided.signals["pedestrian_delay"].reshape(len(SEEDS), -1)
        waited = batch.buffers.people["waited"].sum() - waited
        delays[agents] = lost.sum() / waited
    assert 0 < delays[1] < delays[4] < 1
