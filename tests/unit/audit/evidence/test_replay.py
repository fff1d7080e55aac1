"""Films of single episodes."""

import io
import itertools
import json
import re
from importlib.resources import files

import numpy as np
import pytest
from PIL import Image

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.evidence.replay import (
    GRID_PER_SECOND,
    PER_SECOND,
    check_filmed,
    films_of,
    replayer,
)
from socialiq.audit.profile.profile import world_of
from socialiq.audit.seeds import episode_seeds
from socialiq.errors import UserError
from socialiq.types import RewardPair
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.policies import policy as rule
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make

SCHEMA = json.loads(files("socialiq.audit.report").joinpath("report.schema.json").read_text())
ACTIONS = SCHEMA["$defs"]["trace"]["properties"]["actions"]["pattern"]


class Driving:
    """Chooses one action."""

    def __init__(self, action):
        self.action = action

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full(len(observation), self.action), state


class Alternating:
    """Chooses two actions in turn; it sees one observation at a time, and counts in its state."""

    def __init__(self, *actions):
        self.actions = actions

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        assert np.ndim(observation) == 1
        done = state or 0
        return self.actions[done % len(self.actions)], done + 1


def points(track):
    return [tuple(map(float, one.split(" "))) for one in track.poses.split(";")]


@pytest.fixture(scope="module")
def at_intersection(declared):
    world = declared("intersection").world()
    return world, collect_evidence(world, rule("go"), episode_seeds(2, 40), side_by_side=40)


def test_it_is_the_episode_of_the_evidence(at_intersection):
    world, evidence = at_intersection
    again = replayer(world, rule("go"))
    for place, seed in enumerate(evidence.seeds[:8].tolist()):
        played = again(seed)
        totals = RewardPair(*evidence.policy.totals[place].tolist())
        assert played.repeats(int(evidence.policy.episodes.length[place]), totals)
        assert not played.repeats(int(evidence.policy.episodes.length[place]) + 1, totals)
        assert played.trace.actions == "2" * played.decisions
        assert not played.repeats(played.decisions, RewardPair(totals.env, totals.social + 0.1))


@pytest.mark.parametrize("road", ["merge", "roundabout", "socialiq/Roundabout-v1"])
def test_an_episode_on_a_road_of_highway_env_is_that_of_the_evidence(road):
    world = world_of(road, {})
    waits = Reference("waits", Alternating(4, 4))
    evidence = collect_evidence(world, Alternating(3, 4), episode_seeds(5, 20), [waits])
    again = replayer(world, Alternating(3, 4))
    for place, seed in enumerate(evidence.seeds.tolist()):
        played = again(seed)
        totals = RewardPair(*evidence.policy.totals[place].tolist())
        assert played.repeats(int(evidence.policy.episodes.length[place]), totals)
        assert played.trace.actions == ("34" * played.decisions)[: played.decisions]
        assert re.search(ACTIONS, played.trace.actions)
        assert played.trace.tracks[0].ego


def test_the_ego_comes_from_the_south_and_collides_where_it_did(at_intersection):
    world, evidence = at_intersection
    struck = int(np.flatnonzero(evidence.policy.episodes.contact == Contact.EGO_STRUCK)[0])
    trace = replayer(world, rule("go"))(int(evidence.seeds[struck])).trace
    ego, *others = trace.tracks
    assert trace.per_second == PER_SECOND
    assert ego.ego and ego.crashed and not any(one.ego for one in others)
    way = points(ego)
    assert len(way) == trace.frames
    assert way[0][1] > 40.0 and way[0][2] == -90.0
    hit = [points(one)[-1] for one in others if one.crashed]
    assert min(np.hypot(x - way[-1][0], y - way[-1][1]) for x, y, _ in hit) < 6.0


def test_a_vehicle_moves_no_faster_than_vehicles_do(at_intersection):
    world, evidence = at_intersection
    for track in replayer(world, rule("go"))(int(evidence.seeds[0])).trace.tracks:
        way = np.array(points(track))
        if len(way) > 1:
            assert np.hypot(*np.diff(way[:, :2], axis=0).T).max() < 20.0 / PER_SECOND
            assert np.abs(np.diff(way[:, 2])).max() < 45.0


def test_a_gridworld_step_by_step(declared):
    world = declared("crossing7").world()
    found = collect_evidence(world, Driving(1), episode_seeds(3, 20))
    played = replayer(world, Driving(1))(int(found.seeds[0]))
    totals = RewardPair(*found.policy.totals[0].tolist())
    assert played.repeats(int(found.policy.episodes.length[0]), totals)
    ego, *others = played.trace.tracks
    assert points(ego) == [(float(step), 3.0, 0.0) for step in range(7)]
    assert played.trace.per_second == GRID_PER_SECOND and others
    for one in others:
        way = points(one)
        assert {x for x, _, _ in way} == {3.0} and way[0][1] == 6.0  # from the south
        assert all(later[1] <= earlier[1] for earlier, later in itertools.pairwise(way))


def test_a_policy_that_answers_otherwise_gives_another_episode(at_intersection):
    world, evidence = at_intersection
    played = replayer(world, rule("wait"))(int(evidence.seeds[0]))
    totals = RewardPair(*evidence.policy.totals[0].tolist())
    assert not played.repeats(int(evidence.policy.episodes.length[0]), totals)


def test_a_film_shows_the_episode_of_its_seed():
    world = Intersection(Options(duration=1.0))
    rows = {"worst": [{"seed": "3"}, {"seed": "4"}]}
    found = films_of(world, policy("wait"), rows)
    assert list(found) == ["episodes/worst-1.gif", "episodes/worst-2.gif"]
    assert found["episodes/worst-1.gif"] != found["episodes/worst-2.gif"]
    with Image.open(io.BytesIO(found["episodes/worst-1.gif"])) as film:
        assert (film.format, film.n_frames) == ("GIF", 6)


def test_a_film_of_a_road_of_highway_env_follows_the_ego():
    world = world_of("merge", {"duration": 2.0})
    found = films_of(world, policy("wait"), {"median": [{"seed": str(2**40 + 3)}]})
    with Image.open(io.BytesIO(found["episodes/median-1.gif"])) as film:
        assert (film.format, film.n_frames) == ("GIF", 11)


def test_gridworlds_have_no_films():
    with pytest.raises(UserError, match="leave out --films"):
        check_filmed(make("crossing5"))
