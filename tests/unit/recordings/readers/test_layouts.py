"""Files of our own making in the public layouts of NGSIM, inD, INTERACTION and CommonRoad 2017a."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.readers import import_file
from socialiq_recordings.readers.column_map import read_map
from socialiq_recordings.readers.csv_recording import read_csv

FOOT = 0.3048
# The header of data.transportation.gov 8ect-6jqj; the other distribution differs in one letter.
NGSIM = (
    "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_length,"
    "v_Width,v_Class,v_Vel,v_Acc,Lane_ID,O_Zone,D_Zone,Int_ID,Section_ID,Direction,Movement,"
    "Preceding,Following,Space_Headway,Time_Headway,Location"
)
BEGAN = 1118935680200  # ms


def ngsim(path, header, standing=True):
    """Two periods of one street with the same numbers: one car drives, one stands behind it."""
    rows = [header]
    for period in range(2):
        for frame in range(30):
            time = BEGAN + period * 900_000 + frame * 100
            y, speed = 100 + 40 * frame * 0.1 + period, 40.0
            cars = [(7, 12.0, y, speed)]
            cars += [(8, 12.0, 105.0, 0.0)] if standing and not period else []
            for number, x, along, v in cars:
                rows.append(
                    f"{number},{frame},30,{time},{x},{along},6451137.6,1873342.1,14.5,6.0,2,{v},0,"
                    "2,101,203,1,2,2,1,0,0,0,0,lankershim"
                )
    order = np.random.default_rng(0).permutation(len(rows) - 1) + 1
    path.write_text("\n".join([rows[0], *(rows[one] for one in order)]) + "\n")


@pytest.mark.parametrize("header", [NGSIM, NGSIM.replace("v_length", "v_Length"), NGSIM.lower()])
def test_ngsim_as_it_is(tmp_path, header):
    path = tmp_path / "ngsim.csv"
    ngsim(path, header)
    first, second = read_csv(path, read_map("ngsim"))
    assert first.recording.tracks.recording == "ngsim-period-1"
    assert second.recording.tracks.recording == "ngsim-period-2"
    tracks = first.recording.tracks
    assert tracks.identity.tolist() == [7, 8] and first.refused == ()
    # The car that stands is in the lane of the other, which drives to the north.
    np.testing.assert_allclose(tracks.heading, np.pi / 2, atol=1e-9)
    np.testing.assert_allclose(tracks.vy[:30], 40 * FOOT, rtol=1e-6)
    # Fronts become centres: 14.5 feet long.
    np.testing.assert_allclose(tracks.y[30:], (105 - 14.5 / 2) * FOOT)
    assert tracks.frame.max() == 29 and second.recording.tracks.n_tracks == 1


def test_a_standing_vehicle_takes_the_lanes_heading_or_says_what_to_name(tmp_path, road):
    rows = [NGSIM]
    for frame in range(30):
        rows.append(
            f"8,{frame},30,{BEGAN + 100 * frame},30,6,0,0,14.5,6,2,0,0,2,1,2,1,2,2,1,0,0,0,0,x"
        )
        rows.append(
            f"9,{frame},30,{BEGAN + 100 * frame},999,{9 * frame},0,0,14.5,6,2,90,0,2,1,2,1,2,2,1,"
            "0,0,0,0,x"
        )
    path = tmp_path / "stands.csv"
    path.write_text("\n".join(rows) + "\n")
    [without] = read_csv(path, read_map("ngsim"))
    assert "name the map with --road" in without.refused[0].reason
    [found] = read_csv(path, read_map("ngsim"), road=road)
    tracks = found.recording.tracks
    assert tracks.identity.tolist() == [8, 9] and found.refused == ()
    np.testing.assert_allclose(tracks.heading[:30], 0.0)  # lanelet 1 leads to the east
    assert found.recording.road is road


CR_2017A = """<?xml version="1.0" encoding="UTF-8"?>
<commonRoad commonRoadVersion="2017a" benchmarkID="ZAM_Old-1_1_T-1" date="01-Feb-2017"
 author="ours" affiliation="" source="handmade" tags="urban simulated" timeStepSize="0.1">
 <lanelet id="1"><leftBound><point><x>0</x><y>2</y></point><point><x>50</x><y>2</y></point>
 </leftBound><rightBound><point><x>0</x><y>-2</y></point><point><x>50</x><y>-2</y></point>
 </rightBound><speedLimit>13.9</speedLimit></lanelet>
 <obstacle id="2"><role>dynamic</role><type>car</type>
 <shape><rectangle><length>4.5</length><width>1.8</width></rectangle></shape>
 <trajectory>{states}</trajectory></obstacle>
</commonRoad>
"""
STATE = (
    "<state><position><point><x>{x}</x><y>0</y></point></position><orientation><exact>0</exact>"
    "</orientation><time><exact>{time}</exact></time><velocity><exact>8.0</exact></velocity></state>"
)


@pytest.mark.parametrize("version", ["2017a", "2017b", "2018a", "2018b"])
@pytest.mark.parametrize("seconds", [False, True])
def test_older_commonroad(tmp_path, version, seconds):
    states = [STATE.format(x=0.8 * n, time=f"{n / 10:.1f}" if seconds else n) for n in range(20)]
    path = tmp_path / "old.xml"
    path.write_text(CR_2017A.format(states="".join(states)).replace("2017a", version))
    if seconds and version.startswith("2018"):
        with pytest.raises(UserError, match="no track"):
            import_file(path)
        return
    [found] = import_file(path)
    if seconds:
        path.write_text(
            path.read_text().replace("<exact>1.9</exact></time>", "<exact>1.93</exact></time>")
        )
        with pytest.raises(UserError, match="s is no multiple of the step"):
            import_file(path)
    tracks = found.recording.tracks
    assert tracks.frame.tolist() == list(range(20)) and found.recording.road.lanelets[1]
    assert tracks.source["tags"] == "urban simulated"


@pytest.mark.parametrize(
    "cell", ["\0", "9" * 30, "1" * 5000, "1e400", "nan", "-inf", "0x10", "१२", "1_000", " "]
)
@pytest.mark.parametrize("column", range(8))
def test_cells_of_any_content_are_one_line(tmp_path, column, cell):
    path = tmp_path / "ngsim.csv"
    ngsim(path, NGSIM)
    rows = path.read_text().splitlines()
    cells = rows[5].split(",")
    cells[column] = cell
    path.write_text("\n".join([*rows[:5], ",".join(cells), *rows[6:]]) + "\n")
    try:
        found = import_file(path, "csv", read_map("ngsim"))
        assert all(np.isfinite(one.recording.tracks.x).all() for one in found)
    except UserError as error:
        assert "\n" not in str(error) and len(str(error)) < 600
