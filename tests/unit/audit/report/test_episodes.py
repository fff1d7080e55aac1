"""The evidence as a table reads back exactly."""

import csv
import dataclasses
import io

import numpy as np
import pytest
from PIL import Image

from socialiq.audit.report.episodes import check_filmed, evidence_csv, films_of
from socialiq.errors import UserError
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make


def test_numbers_read_back_exactly(audited):
    evidence = audited.evidence
    rows = list(csv.DictReader(io.StringIO(evidence_csv(evidence))))
    assert [int(row["seed"]) for row in rows] == evidence.seeds.tolist()
    for driver in (evidence.policy, *evidence.references):
        names = [f"{driver.name}.r_env", f"{driver.name}.r_social"]
        read = np.array([[float(row[name]) for name in names] for row in rows])
        np.testing.assert_array_equal(read, driver.totals)
    assert [int(row["decisions"]) for row in rows] == evidence.policy.length.tolist()
    assert rows[0]["density"] == evidence.strata["density"][0]


def test_no_name_is_a_formula_for_a_spreadsheet(audited):
    first, *others = audited.evidence.references
    named = dataclasses.replace(first, name='=HYPERLINK("x")')
    evidence = dataclasses.replace(audited.evidence, references=(named, *others))
    head = next(csv.reader(io.StringIO(evidence_csv(evidence))))
    assert not any(name.startswith("=") for name in head)


def test_a_film_shows_the_episode_of_its_seed():
    world = Intersection(Options(duration=1.0))
    rows = {"worst": [{"seed": "3"}, {"seed": "4"}]}
    found = films_of(world, policy("wait"), rows)
    assert list(found) == ["episodes/worst-1.gif", "episodes/worst-2.gif"]
    assert found["episodes/worst-1.gif"] != found["episodes/worst-2.gif"]
    with Image.open(io.BytesIO(found["episodes/worst-1.gif"])) as film:
        assert (film.format, film.n_frames) == ("GIF", 6)


def test_gridworlds_have_no_films():
    with pytest.raises(UserError, match="leave out --films"):
        check_filmed(make("crossing5"))
