"""Films of single episodes."""

import io

import pytest
from PIL import Image

from socialiq.audit.evidence.replay import check_filmed, films_of
from socialiq.audit.profile.profile import world_of
from socialiq.errors import UserError
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make


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
