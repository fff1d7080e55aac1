"""Our reader beside commonroad-io, which needs an environment of its own: it pins an old protobuf.

SOCIALIQ_COMMONROAD_PYTHON is a Python that has commonroad-io, SOCIALIQ_COMMONROAD_DATA a folder
with the twelve recorded scenarios; `.ci/run` sets both. They are never part of the project.
"""

import json
import os
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.physics import wrapped_heading
from socialiq_recordings.readers.commonroad import read_commonroad
from socialiq_recordings.readers.commonroad_xml import TYPES

OWN = sorted((Path(__file__).parents[2] / "examples" / "recordings").glob("*.xml"))
FOLDER = os.environ.get("SOCIALIQ_COMMONROAD_DATA", "")
RECORDED = sorted(Path(FOLDER).glob("*.xml")) if FOLDER else []
ours = cache(read_commonroad)
needs_data = pytest.mark.skipif(not RECORDED, reason="SOCIALIQ_COMMONROAD_DATA is not set")


@pytest.fixture(scope="module")
def theirs():
    python = os.environ.get("SOCIALIQ_COMMONROAD_PYTHON", "")
    if not python:
        pytest.skip("SOCIALIQ_COMMONROAD_PYTHON is not set")
    script = Path(__file__).with_name("commonroad_dump.py")
    command = [python, str(script), *map(str, OWN + RECORDED)]
    # The other environment must not see ours.
    clean = {name: one for name, one in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(command, capture_output=True, check=True, env=clean)
    return json.loads(done.stdout)


@pytest.mark.parametrize("path", OWN + RECORDED, ids=lambda path: path.stem)
def test_tracks_are_those_of_commonroad_io(theirs, path):
    found, imported = theirs[str(path)], ours(path)
    tracks = imported.recording.tracks
    assert imported.refused == ()
    assert tracks.dt == found["dt"] and tracks.recording == found["recording"]
    assert tracks.identity.tolist() == [one["identity"] for one in found["tracks"]]
    assert tracks.road_user.tolist() == [TYPES[one["type"]] for one in found["tracks"]]
    for side in ("length", "width"):
        assert getattr(tracks, side).tolist() == [one[side] for one in found["tracks"]]
    lengths = [len(one["states"]) for one in found["tracks"]]
    assert np.diff(tracks.starts).tolist() == lengths
    states = np.array([state for one in found["tracks"] for state in one["states"]])
    frame, x, y, heading, velocity, slip = states.T
    np.testing.assert_array_equal(tracks.frame, frame)
    np.testing.assert_array_equal(tracks.x, x)
    np.testing.assert_array_equal(tracks.y, y)
    np.testing.assert_array_equal(tracks.heading, wrapped_heading(heading))
    np.testing.assert_array_equal(tracks.vx, velocity * np.cos(heading + slip))
    np.testing.assert_array_equal(tracks.vy, velocity * np.sin(heading + slip))


@pytest.mark.parametrize("path", OWN + RECORDED, ids=lambda path: path.stem)
def test_lanelets_are_those_of_commonroad_io(theirs, path):
    lanelets = ours(path).recording.road.lanelets
    found = {one["identity"]: one for one in theirs[str(path)]["lanelets"]}
    assert set(lanelets) == set(found)
    for identity, lanelet in lanelets.items():
        their = found[identity]
        for name in ("left", "right", "centre"):
            np.testing.assert_array_equal(getattr(lanelet, name), their[name])
        assert list(lanelet.successors) == their["successors"]
        assert list(lanelet.predecessors) == their["predecessors"]
        for side in ("adjacent_left", "adjacent_right"):
            assert list(getattr(lanelet, side) or (None, None)) == their[side]
        line = lanelet.stop_line
        assert (None if line is None else line.tolist()) == their["stop_line"]


@pytest.mark.recorded
@needs_data
def test_there_are_twelve_recorded_scenarios():
    assert len(RECORDED) == 12


@pytest.mark.recorded
@needs_data
def test_recorded_tracks_pass_the_checks_but_one(tmp_path, capsys):
    folder = tmp_path / "out"
    arguments = [
        "data",
        "import",
        "commonroad",
        *map(str, RECORDED),
        "--out",
        str(folder),
        "--json",
    ]
    assert main(arguments) == 0
    recordings = json.loads(capsys.readouterr().out)["recordings"]
    assert sum(one["tracks"] for one in recordings) == 335
    assert sum(one["states"] for one in recordings) == 16_827
    assert all(one["skipped"] == {"planningProblem": 1} for one in recordings)
    [(recording, refused)] = [
        (one["recording"], told) for one in recordings for told in one["refused"]
    ]
    assert recording == "USA_Lanker-2_16_T-1" and refused["identity"] == "25"
    assert refused["reason"].startswith("drives 22.21 m/s but states 15.64")
    assert len(list(folder.glob("*.safetensors"))) == 12
