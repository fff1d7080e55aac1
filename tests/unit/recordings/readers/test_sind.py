import json

import numpy as np
import pytest
from tests.fuzz.samples import make_sind

from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq_recordings import files
from socialiq_recordings.readers import import_file
from socialiq_recordings.recording import RoadUser


@pytest.fixture
def folder(tmp_path):
    make_sind(tmp_path / "sind")
    return tmp_path / "sind"


@pytest.mark.parametrize("named", ["Ped", "Veh"])
def test_pedestrians_vehicles_and_lights_are_one_recording(folder, named):
    (imported,) = import_file(folder / f"made_{named}_smoothed_tracks.csv", "sind")
    tracks = imported.recording.tracks
    kinds = [RoadUser.PEDESTRIAN, RoadUser.PEDESTRIAN, RoadUser.CAR, RoadUser.OTHER]
    assert tracks.road_user.tolist() == kinds
    assert (tracks.recording, tracks.dt) == ("made", pytest.approx(0.1))
    assert tracks.width.tolist() == pytest.approx([0.6, 0.6, 1.8, 1.1])
    # P1 and the car 1 have one number in the files.
    assert tracks.identity.tolist() == [1, 2, 3, 4]
    assert tracks.source["track_ids"] == {"1": "P1", "2": "P2", "3": "1", "4": "2"}
    assert tracks.heading[tracks.track == 0] == pytest.approx(np.pi / 2)
    # Frame 30 of the video is no frame of a time: 42 is 4, three are one.
    lights = {"Traffic light 1": [[0, "red"], [6, "green"]]}
    lights["Traffic light 2"] = [[0, "green"], [4, "yellow"], [10, "red"]]
    assert tracks.source["lights"] == lights
    assert imported.skipped == {"light without lanelets": 2}


def test_pedestrians_alone_are_read_and_counted(folder, tmp_path, capsys):
    for name in ("Veh_smoothed_tracks", "Traffic_Lights"):
        (folder / f"made_{name}.csv").unlink()
    path = folder / "made_Ped_smoothed_tracks.csv"
    with path.open("a") as file:  # a third that jumps
        file.writelines(f"P3,{f},{100 * f},pedestrian,{50 * (f % 2)},0,0,1,0,0\n" for f in range(9))
    assert main(["data", "import", "sind", str(path), "--out", str(tmp_path / "in"), "--json"]) == 0
    made = json.loads(capsys.readouterr().out)
    row = {"road_user": "pedestrian", "read": 3, "used": 2, "left_out": 1, "why": "see refused.csv"}
    assert made["road_users"] == [row]
    assert "pedestrian" in (tmp_path / "in" / "refused.csv").read_text().splitlines()[1]
    assert files.load(tmp_path / "in" / "made.safetensors").tracks.n_tracks == 2
    assert main(["data", "inspect", str(tmp_path / "in"), "--json"]) == 0
    row |= {"read": 2, "left_out": 0, "why": ""}
    assert json.loads(capsys.readouterr().out)["road_users"] == [row]


def test_other_files_are_refused(folder, tmp_path):
    with pytest.raises(UserError, match="ends in Ped_smoothed_tracks"):
        import_file(folder / "made_Traffic_Lights.csv", "sind")
    (folder / "made_lights_2.csv").write_text("RawFrameID,timestamp(ms),Light\n3,1,1\n")
    with pytest.raises(UserError, match="2 files of lights"):
        import_file(folder / "made_Ped_smoothed_tracks.csv", "sind")
