"""CSV files by column maps: the shipped layouts, and everything that can be wrong with a file."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.readers import csv_table, import_file
from socialiq_recordings.readers.column_map import known_maps, read_map
from socialiq_recordings.readers.csv_recording import read_csv
from socialiq_recordings.recording import RoadUser

MAP = """
[time]
rate = 10.0
[columns]
id = "who"
frame = "frame"
x = "x"
y = "y"
heading = "heading"
vx = "vx"
vy = "vy"
length = "length"
width = "width"
class = "class"
[classes]
Car = "car"
Person = "pedestrian"
[default_sizes]
Person = [0.5, 0.4]
"""
HEAD = "who,frame,x,y,heading,vx,vy,length,width,class"


def rows_of(who, frames, speed=5.0, kind="Car", heading="0.0", size="4.5,1.8"):
    return [f"{who},{f},{speed * f / 10},{who},{heading},{speed},0.0,{size},{kind}" for f in frames]


GOOD = rows_of(1, range(4))


@pytest.fixture
def read(tmp_path):
    def made(rows, head=HEAD, said=MAP, name="t.csv", **options):
        (tmp_path / "map.toml").write_text(said)
        path = tmp_path / name
        text = rows if isinstance(rows, str) else "\n".join([head, *rows]) + "\n"
        path.write_text(text)
        return read_csv(path, read_map(str(tmp_path / "map.toml")), **options)

    return made


def test_rows_become_tracks(read):
    # Rows of two road users in turn, as many files have them.
    rows = [row for pair in zip(GOOD, rows_of(2, range(3, 7)), strict=True) for row in pair]
    [imported] = read(rows)
    tracks = imported.recording.tracks
    assert tracks.identity.tolist() == [1, 2]
    assert tracks.frame.tolist() == [0, 1, 2, 3, 3, 4, 5, 6]
    assert tracks.x.tolist() == [0.0, 0.5, 1.0, 1.5, 1.5, 2.0, 2.5, 3.0]
    assert tracks.y.tolist() == [1.0] * 4 + [2.0] * 4
    assert tracks.dt == 0.1 and tracks.recording == "t" and imported.n_states == 8
    assert tracks.source["format"] == "map" and len(tracks.source["sha256"]) == 64


def test_missing_headings_and_sizes_of_people(read):
    walk = rows_of(2, range(4), speed=1.5, kind="Person", heading="", size=",")
    tracks = read([*GOOD, *walk])[0].recording.tracks
    assert tracks.road_user.tolist() == [RoadUser.CAR, RoadUser.PEDESTRIAN]
    assert tracks.length.tolist() == [4.5, 0.5] and tracks.width.tolist() == [1.8, 0.4]
    assert tracks.heading[4:].tolist() == [0.0] * 4


def test_units_and_axes(read):
    said = MAP + '[units]\nposition = "ft"\nvelocity = "km/h"\nheading = "degrees"\n'
    said += '[axes]\ny = "down"\n'
    row = "1,0,10.0,20.0,30.0,36.0,72.0,4.5,1.8,Car"
    tracks = read([row], said=said)[0].recording.tracks
    assert tracks.x.tolist() == [3.048] and tracks.y.tolist() == [-6.096]
    np.testing.assert_allclose(tracks.heading, [-np.pi / 6])
    np.testing.assert_allclose((tracks.vx, tracks.vy), ([10.0], [-20.0]))


@pytest.mark.parametrize(("point", "x"), [("front", 10 - 2.25), ("corner", 10 + 2.25)])
def test_points_of_a_box(read, point, x):
    tracks = read(
        ["1,0,10.0,20.0,0.0,5.0,0.0,4.5,1.8,Car"], said=MAP + f'[axes]\npoint = "{point}"'
    )
    assert tracks[0].recording.tracks.x.tolist() == [x]
    assert tracks[0].recording.tracks.y.tolist() == [20.0 if point == "front" else 20 - 0.9]


def test_times_stand_for_frames(read):
    said = MAP.replace('frame = "frame"', 'time = "frame"') + '[units]\ntime = "ms"\n'
    rows = [
        row.replace(f"1,{f},", f"1,{1_500_000_000_000 + 100 * f},", 1) for f, row in enumerate(GOOD)
    ]
    assert read(rows, said=said)[0].recording.tracks.frame.tolist() == [0, 1, 2, 3]
    rows[2] = rows[2].replace("200,", "250,", 1)
    with pytest.raises(
        UserError, match=r"row 4: the time is not a multiple of 0.1 s after the first"
    ):
        read(rows, said=said)


def test_frames_and_times_have_to_tell_the_same_rate(read):
    said = MAP.replace("[columns]", '[columns]\ntime = "ms"') + '[units]\ntime = "ms"\n'
    for step, fits in ((100, True), (40, False)):
        rows = [f"{row},{step * place}" for place, row in enumerate(GOOD)]
        if fits:
            assert read(rows, HEAD + ",ms", said)[0].recording.tracks.n_states == 4
        else:
            with pytest.raises(
                UserError, match=r"row 3: 0.04 s after the frame before.*0.1 s apart"
            ):
                read(rows, HEAD + ",ms", said)


def test_repeated_ids_and_any_order_and_recordings(read):
    said = MAP.replace("rate = 10.0", 'rate = 10.0\norder = "any"\nrepeated_ids = true')
    said = said.replace("[columns]", '[columns]\nrecording = "site"')
    rows = [f"{row},a" for row in (*GOOD[::-1], *rows_of(1, range(9, 12)))]
    rows += [f"{row},b" for row in rows_of(1, range(2))]
    first, second = (one.recording.tracks for one in read(rows, HEAD + ",site", said))
    assert (first.recording, second.recording) == ("t-a", "t-b")
    assert first.identity.tolist() == [1, 1] and first.frame.tolist() == [0, 1, 2, 3, 9, 10, 11]
    assert second.frame.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (rows_of(2, [0, 1, 3]), "row 8: frame 3 follows frame 1: a gap of 1"),
        ([*rows_of(2, [0, 1]), rows_of(2, [1], 6.0)[0]], "row 8: frame 1 is there twice"),
        (rows_of(2, [5, 4]), "row 7: time goes back: frame 4 follows frame 5"),
        (rows_of(2, [0, 1], heading=""), None),
        (rows_of(2, [0, 1], heading="inf"), "row 6: the heading is inf, more than a turn"),
        (
            [*rows_of(2, [0]), "2,1,x,2,0,5,0,4,2,Car", *rows_of(2, [2])],
            "row 7: x is 'x', not a num",
        ),
        ([*rows_of(2, [0]), "2,1,3", *rows_of(2, [2])], "row 7: 3 cells, so columns are missing"),
        (rows_of(2, [0, 1], size=","), "it has no size, nor has car a default"),
        (
            rows_of(2, [0, 1], speed=float("nan")),
            "row 6: x or y is missing, not finite or too large",
        ),
        ([*rows_of(2, [0]), *rows_of(2, [1], kind="Person")], "its class changes from 'Car'"),
    ],
)
def test_a_bad_track_is_left_out_with_its_row(read, bad, reason):
    if reason is None:
        assert read([*GOOD, *bad])[0].refused == ()
        return
    [imported] = read([*GOOD, *bad])
    assert imported.recording.tracks.identity.tolist() == [1]
    [refused] = imported.refused
    assert refused.identity == "2" and reason in refused.reason


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        ("", "is empty"),
        (HEAD + "\n", "has no row but its header"),
        ("\x00" * 50, "has no column who"),
        (["2,0,1"], "row 2: 3 cells"),
        ([GOOD[0].replace("1,0,", " ,0,", 1)], "row 2: who is ' *', not a name"),
        ([GOOD[0].replace("1,0,", "1,0.5,", 1)], "row 2: frame is '0.5', not a whole"),
        ([GOOD[0].replace(",0.0,", ",east,", 1)], "row 2: x is 'east', not a number"),
        (rows_of(2, [0], kind="Dragon"), "row 2: class 'Dragon' is not in"),
        (rows_of(1, range(3), heading="359.0"), r"row 2: the heading is 359.*these are degrees"),
        (rows_of(1, [3, 2]), "no track can be used; the first, 1: row 3: time goes back"),
        ("a" * (2 << 20), "a line is longer than 1 MiB"),
        ('"' + "a,\n" * 100_000, "field larger than field limit|is this a CSV file"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(read, tmp_path, rows, line):
    with pytest.raises(UserError, match=line) as caught:
        read(rows)
    assert str(tmp_path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("bad", ["2,0,1", "nan,0,0,1,0,5,0,4,2,Car", "1,0.5,0,1,0,5,0,4,2,Car"])
def test_no_file_is_refused_for_one_bad_row(read, bad):
    [imported] = read([*GOOD, bad])
    assert imported.recording.tracks.n_states == imported.n_states == 4
    assert imported.skipped == {"row": 1} and imported.refused == ()


def test_missing_columns_are_named_with_those_that_are_there(read):
    with pytest.raises(
        UserError, match="has no column x, y: correct the column map; the file has who"
    ):
        read(GOOD, HEAD.replace(",x,y,", ",a,b,"))
    with pytest.raises(UserError, match="has two columns x"):
        read(GOOD, HEAD + ",x")


def test_a_file_that_is_no_text(read, tmp_path):
    path = tmp_path / "t.csv"
    path.write_bytes(b"\xff\xfe" * 100)
    with pytest.raises(UserError, match="is not UTF-8 text"):
        read_csv(path, read_map("interaction"))
    with pytest.raises(UserError, match="no such file"):
        read_csv(tmp_path / "absent.csv", read_map("interaction"))


def test_more_states_than_allowed_are_refused_before_they_fill_the_memory(read, monkeypatch):
    monkeypatch.setattr(csv_table, "_ROWS", 3)
    rows = rows_of(1, range(10))
    assert read(rows, most_states=10)[0].recording.tracks.n_states == 10
    with pytest.raises(UserError, match="more than 9 states"):
        read(rows, most_states=9)


def test_memory_is_linear_in_the_states(read, monkeypatch):
    monkeypatch.setattr(csv_table, "_ROWS", 50)

    def peak(n):
        rows = "\n".join([HEAD, *(row for one in range(n) for row in rows_of(one, range(50)))])
        tracemalloc.start()
        read(rows)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    read(GOOD)  # whatever is imported late
    assert peak(80) < 4.4 * peak(20)


def test_pieces_of_any_size_give_the_same(read, monkeypatch):
    rows = [*GOOD, *rows_of(2, range(5), kind="Person", size=",", speed=1.0)]
    whole = read(rows)[0].recording.tracks
    monkeypatch.setattr(csv_table, "_ROWS", 2)
    pieces = read(rows)[0].recording.tracks
    for name, column in whole.arrays().items():
        np.testing.assert_array_equal(getattr(pieces, name), column)


@pytest.mark.parametrize(
    ("said", "line"),
    [
        ("[", "is not TOML"),
        (MAP.replace("[columns]", "[colums]"), "colums is unknown"),
        (MAP.replace('x = "x"', ""), "lacks x"),
        (MAP.replace('frame = "frame"', ""), "lacks frame"),
        (MAP.replace('vy = "vy"', ""), "vx and vy, both or none"),
        (MAP.replace('class = "class"', ""), r"lacks class \(or default_class\)"),
        (MAP.replace("[time]", 'default_class = "Bus"\n[time]'), "unknown default_class 'Bus'"),
        (MAP.replace("[time]", "optional = [[]]\n[time]"), "optional must be a list of columns"),
        (MAP.replace("[time]", 'optional = ["z"]\n[time]'), "optional must be a list of columns"),
        (
            MAP.replace('length = "length"', "").split("[default_sizes]")[0],
            r"lacks length \(or .default_sizes.\)",
        ),
        (MAP.replace("rate = 10.0", "rate = 0"), "needs a rate"),
        (MAP.replace('"car"', '"dragon"'), "unknown class of 'Car' 'dragon'"),
        (MAP + '[units]\nposition = "inch"', "unknown unit of position 'inch'"),
        (MAP + '[axes]\ny = "left"', "axes.y is 'left'"),
        (MAP.replace("[0.5, 0.4]", "[0.5]"), "must be .length, width."),
        (MAP + '[road_users]\nfile = ["a"]\nid = "b"', "must be a list of two texts"),
        (MAP + '[road_users]\nfile = ["a", "b"]', "a file but no id"),
        (
            MAP.replace("rate = 10.0", "rate = 10.0\nperiods = true"),
            "periods needs the columns time",
        ),
        (MAP + '[map]\norigin = ["a", "b"]', "origin needs time.rate_file"),
        (MAP.split("[classes]")[0], "classes. is missing"),
    ],
)
def test_a_bad_column_map_is_refused(read, said, line):
    with pytest.raises(UserError, match=line):
        read(GOOD, said=said)


WITHOUT = {
    "length": 'length = "length"\n',
    "width": 'width = "width"\n',
    "class": 'class = "class"\n',
}
"""Lines of the map that name columns which a file may lack."""


def without(columns, rows):
    """Return the head and the rows of a file without some of its columns."""
    names = HEAD.split(",")
    stays = [name not in columns for name in names]
    lines = [
        ",".join(cell for cell, stay in zip(row.split(","), stays, strict=True) if stay)
        for row in (HEAD, *rows)
    ]
    return lines[0], lines[1:]


@pytest.mark.parametrize("is_named", [True, False], ids=["optional", "no column of the map"])
@pytest.mark.parametrize("columns", [("class",), ("length", "width"), ("length", "width", "class")])
def test_sizes_and_classes_of_files_without_them(read, columns, is_named):
    head, rows = without(columns, GOOD)
    said = 'default_class = "Car"\n' + MAP + "Car = [4.7, 1.9]\n"
    if is_named:
        said = f"optional = {[*columns]}\n" + said
    for name in columns if not is_named else ():
        said = said.replace(WITHOUT[name], "")
    tracks = read(rows, head, said)[0].recording.tracks
    assert tracks.road_user.tolist() == [RoadUser.CAR]
    size = (4.5, 1.8) if columns == ("class",) else (4.7, 1.9)
    assert (*tracks.length, *tracks.width) == size


def test_an_empty_class_is_the_default(read):
    rows = [*GOOD, *rows_of(2, range(4), speed=1.5, kind="Person"), *rows_of(3, range(4), kind="")]
    tracks = read(rows, said='default_class = "Car"\n' + MAP)[0].recording.tracks
    assert tracks.road_user.tolist() == [RoadUser.CAR, RoadUser.PEDESTRIAN, RoadUser.CAR]
    tracks = read(rows)[0].recording.tracks
    assert tracks.road_user.tolist()[-1] == RoadUser.OTHER


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        (["who"], "lacks id"),
        (["x"], "lacks x"),
        (["frame"], r"lacks frame \(or time\)"),
        (["vy"], "lacks vx and vy, both or none"),
        (["class"], r"lacks class \(or default_class\)"),
    ],
)
def test_an_optional_column_that_a_file_needs_is_named(read, columns, line):
    head, rows = without(columns, GOOD)
    with pytest.raises(UserError, match=f"t.csv {line}: correct the column map"):
        read(rows, head, f"optional = {columns}\n{MAP}")


@pytest.mark.parametrize("columns", [["vx", "vy"], ["heading"]])
def test_motion_without_its_optional_columns_is_that_of_the_positions(read, columns):
    head, rows = without(columns, GOOD)
    tracks = read(rows, head, f"optional = {columns}\n{MAP}")[0].recording.tracks
    np.testing.assert_allclose(tracks.vx, 5.0)
    np.testing.assert_allclose(tracks.heading, 0.0, atol=1e-9)


def test_a_speed_lies_along_the_heading(read):
    said = MAP.replace('vx = "vx"\nvy = "vy"', 'speed = "vx"')
    rows = rows_of(1, range(4), heading="0.5")
    tracks = read(rows, said=said)[0].recording.tracks
    np.testing.assert_allclose(
        (tracks.vx, tracks.vy), (5 * np.cos([0.5] * 4), 5 * np.sin([0.5] * 4))
    )


@pytest.mark.parametrize("separator", [";", "\t", "|", " "])
def test_separators_and_units_of_sizes(read, separator):
    said = f'licence = "ours"\nformat = "mine"\nseparator = "{separator}"\n{MAP}'
    said = said.replace("\t", "\\t") + '[units]\nsize = "ft"\nvelocity = "mph"\n'
    rows = [row.replace(",", separator) for row in rows_of(1, range(1), speed=10.0)]
    [imported] = read(rows, HEAD.replace(",", separator), said)
    tracks = imported.recording.tracks
    np.testing.assert_allclose((tracks.length, tracks.width), [[4.5 * 0.3048], [1.8 * 0.3048]])
    np.testing.assert_allclose(tracks.vx, [4.4704])
    assert tracks.source["licence"] == "ours" and tracks.source["format"] == "mine"


def test_stated_errors_are_those_of_the_map(tmp_path):
    stated = {"position": 0.1, "speed": 0.2, "heading": 1.0, "size": 0.3, "scale": 0.02}
    lines = "".join(f"{name} = {value}\n" for name, value in stated.items())
    (tmp_path / "map.toml").write_text(f"{MAP}[error]\n{lines}")
    error = read_map(str(tmp_path / "map.toml")).error
    assert {name: getattr(error, name) for name in stated} == stated


def test_the_documented_map_has_every_table_and_is_read(tmp_path):
    page = Path(__file__).parents[4] / "docs" / "recordings.md"
    [text] = [part for part in page.read_text().split("```") if "default_class" in part]
    (tmp_path / "map.toml").write_text(text.removeprefix("toml"))
    columns = read_map(str(tmp_path / "map.toml"))
    assert columns.default_class == "Car" and columns.default_sizes == {"Pedestrian": (0.5, 0.5)}


def test_unknown_maps_are_refused_with_those_there_are():
    assert known_maps() == ("highd", "ind", "interaction", "ngsim", "sind")
    with pytest.raises(UserError, match=r"unknown column map .* 'waymo'"):
        read_map("waymo")


def test_highd_boxes_point_down(tmp_path):
    # Two cars, to the east and to the west; y grows downwards; corners of boxes 5 by 2 m.
    head = "frame,id,x,y,width,height,xVelocity,yVelocity"
    rows = [f"{f},1,{f * 1.2},10.0,5.0,2.0,30.0,0.0" for f in range(1, 6)]
    rows += [f"{f},2,{200 - f * 1.2},4.0,5.0,2.0,-30.0,0.0" for f in range(1, 6)]
    (tmp_path / "01_tracks.csv").write_text("\n".join([head, *rows]))
    (tmp_path / "01_tracksMeta.csv").write_text("id,width,height,class\n1,5,2,Car\n2,5,2,Truck")
    (tmp_path / "01_recordingMeta.csv").write_text("id,frameRate\n1,25")
    [imported] = import_file(tmp_path / "01_tracks.csv", "csv", read_map("highd"))
    tracks = imported.recording.tracks
    assert tracks.recording == "01" and tracks.dt == 0.04
    assert tracks.road_user.tolist() == [RoadUser.CAR, RoadUser.TRUCK]
    np.testing.assert_allclose(tracks.y, [-11.0] * 5 + [-5.0] * 5)
    np.testing.assert_allclose(tracks.x[[0, 5]], [1.2 + 2.5, 200 - 1.2 + 2.5])
    np.testing.assert_allclose(tracks.heading, [0.0] * 5 + [np.pi] * 5)
