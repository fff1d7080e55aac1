"""Accelerations and steering on a recorded road."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely", reason="extra `data` is not installed")

from socialiq.cli.main import main
from socialiq.demonstrations import files as demonstration_files
from socialiq_lab.results import load
from socialiq_recordings import files
from socialiq_recordings.episodes.decisions import decisions_at
from socialiq_recordings.episodes.scene import Scene
from socialiq_recordings.readers.commonroad import read_commonroad

EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "recordings").glob("*.xml"))
FOLDER = os.environ.get("SOCIALIQ_COMMONROAD_DATA", "")


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "example.safetensors"
    files.save(path, read_commonroad(EXAMPLES[0]).recording)
    return path


def test_a_car_that_brakes_on_a_straight_lane(example):
    scene = Scene(files.load(example))
    track = int(np.flatnonzero(scene.tracks.identity == 102)[0])
    rows = np.arange(scene.rows(track).start, scene.rows(track).stop, 5)  # every second
    found = decisions_at(scene, rows)
    # 8 m/s for a second, then to a stand at 4.2 s: -2.5 m/s².
    assert found.acceleration[:4] == pytest.approx([0.0, -2.5, -2.5, -2.5], abs=1e-3)
    assert found.curvature == pytest.approx(np.zeros(len(rows) - 1), abs=1e-9)
    assert found.lateral == pytest.approx(np.zeros(len(rows) - 1), abs=1e-3)
    assert set(found.lanelet.tolist()) <= {4, 5, 6}
    assert found.ahead[:4] == pytest.approx(np.zeros(4), abs=1e-2)


def test_the_command_writes_every_decision(example, tmp_path, capsys):
    out = tmp_path / "decisions"
    assert main(["data", "decisions", str(example), "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    results = load(out)
    assert len(results.tables["decisions"]) == found["discretisations"][0]["decisions"]
    assert results.summary["supported_seconds"] is not None


def test_demonstrations_take_levels_of_acceleration(example, tmp_path, capsys):
    out = tmp_path / "human.safetensors"
    call = ["data", "demonstrations", str(example), "--actions", "accelerations"]
    assert main([*call, "--levels", "-2", "0", "2", "--out", str(out)]) == 0
    table = demonstration_files.load(out)
    assert table.n_actions == 3 and set(table.action.tolist()) <= {0, 1, 2}
    capsys.readouterr()
    assert main([*call, "--levels", "1", "0", "--out", str(tmp_path / "x.safetensors")]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1 and "ascending" in said.err


@pytest.mark.recorded
@pytest.mark.skipif(not FOLDER, reason="SOCIALIQ_COMMONROAD_DATA names no folder")
def test_recorded_drivers_support_one_decision_a_second(tmp_path, capsys):
    from socialiq_recordings.episodes import support

    paths = [p for p in sorted(Path(FOLDER).glob("*.xml")) if p.stem != "USA_Lanker-1_17_T-1"]
    rows = support.rates([read_commonroad(path).recording.tracks for path in paths])
    committed = load(Path(__file__).parents[2] / "results" / "recordings-decisions")
    # Half a second lies on the limit.
    assert support.supported(rows) in (0.5, 1.0)
    assert committed.summary["supported_seconds"] in (0.5, 1.0)
    for row, there in zip(rows, committed.tables["rates"], strict=True):
        # `data import` leaves out one track that the reader still has
        assert row["reliability"] == pytest.approx(there["reliability"], abs=0.02)
