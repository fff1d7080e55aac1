"""The study of other roads: a committed policy drives as in its results; means are of all seeds."""

import numpy as np
import pytest
from studies.roads.study import POLICIES, QUANTITIES
from studies.roads.work import begun, outcome

from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results
from socialiq.worlds.highway.world import world_of
from socialiq_lab import results as store
from socialiq_lab.tables import matching

RESULTS = store.load(packaged_results() / "roads")


@pytest.mark.parametrize(("road", "angle"), [("merge", 0.0), ("roundabout", 90.0)])
def test_the_dial_of_the_intersection_drives_there_as_before(road, angle):
    world, (first, episodes) = world_of(road), (RESULTS.config["first_seed"], 1000)
    policy = DialPolicy.of(begun(world), 1.0, 0.0, 90.0, {}).at(angle)
    found = outcome(world, policy, np.arange(first, first + episodes), angle)
    name = "intersection's dial, as it is"
    theirs = matching(RESULTS.tables["policies"], road=road, policy=name, angle=angle)
    assert len(theirs) == len(RESULTS.config["seeds"])
    for row in theirs:
        assert found == pytest.approx({key: row[key] for key in found}, abs=0.01)


def test_means_are_over_all_seeds():
    for row in RESULTS.tables["means"]:
        key = {name: row[name] for name in ("road", "policy", "angle")}
        seeds = matching(RESULTS.tables["policies"], **key)
        assert [one["seed"] for one in seeds] == RESULTS.config["seeds"]
        for name in set(QUANTITIES) - {"score_error"}:
            assert row[name] == pytest.approx(np.mean([one[name] for one in seeds]), abs=1e-5)
    assert len(RESULTS.tables["means"]) == len(POLICIES) * 3 * 2
