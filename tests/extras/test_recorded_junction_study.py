"""Study at a recorded junction: the world is made again, and drivers that are rules drive it."""

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely", reason="extra `maps` is not installed")

from socialiq import results_folder as store
from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Reference
from socialiq.demonstrations import files
from socialiq.storage import packaged_results
from socialiq.types import Ending
from socialiq_lab.registry import find
from socialiq_recordings.world.recorded_world import RecordedWorld
from studies.recorded_junction_practice.work import HUMAN, WORLD, Made, contents, make_world, rules

FOLDER = os.environ.get("SOCIALIQ_COMMONROAD_DATA", "")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.recorded,
    pytest.mark.skipif(not FOLDER, reason="SOCIALIQ_COMMONROAD_DATA names no folder"),
]


def test_world_demonstrations_and_rules_are_those_of_the_results(tmp_path: Path) -> None:
    """Counts are equal, and so is what rules earn: they are discrete, without a network."""
    committed = store.load(packaged_results() / "recorded-junction-practice")
    config = find("recorded-junction-practice").Config(recordings=FOLDER)
    make_world(Made(FOLDER, contents(config), config.every), tmp_path, {}, lambda _share: None)
    world = RecordedWorld.load(tmp_path / WORLD)
    counts = {key: committed.summary[key] for key in ("vehicles", "egos", "closures")}
    assert {key: world.provenance[key] for key in counts} == counts
    human = files.load(tmp_path / HUMAN).counts()["human"]
    data = {row["driver"]: row for row in committed.tables["data"]}
    assert human == (data["human"]["episodes"], data["human"]["decisions"])
    wanted = {row["driver"]: row for row in committed.tables["drivers"]}
    seeds = np.arange(config.episodes) + config.first_episode
    course = Course(world, seeds, 200)
    own = [Reference(name, world.driver(name)) for name in world.references]
    planted = [Reference(rule.name, rule) for rule in rules(world)[1:3]]
    for one in [*own, *planted]:
        found, theirs = course.drive(one), wanted[one.name]
        assert found.mean.env == pytest.approx(theirs["r_env"], abs=1e-3), one.name
        assert found.mean.social == pytest.approx(theirs["r_social"], abs=1e-3), one.name
        arrived = float((found.episodes["ending"] == Ending.ARRIVAL).mean())
        assert arrived == pytest.approx(theirs["arrival"], abs=1e-6), one.name
