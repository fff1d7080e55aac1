import stat
from pathlib import Path

import matplotlib.colors
import numpy as np
import pytest
from PIL import Image

from socialiq.errors import UserError
from socialiq.types import RewardPair
from socialiq.worlds.highway import render, shapes, sheet
from socialiq.worlds.highway.options import VEHICLE
from socialiq.worlds.intersection.core.geometry import LANES, STRAIGHT
from socialiq.worlds.intersection.views import Crossing
from socialiq.worlds.pictures import EGO, OTHER, pixels

SIGNALS = {"progress": 0.6, "step": -0.15, "disruption": -0.4}
EAST, NORTH = 0.0, -np.pi / 2
VIEW = Crossing()


def car(x, y, heading, destination=2, **fields):
    record = np.zeros((), VEHICLE)
    for name, value in {"x": x, "y": y, "heading": heading, "speed": 8.0, **fields}.items():
        record[name] = value
    record["destination"] = destination
    return record


def scene(ego_y=46.0, braking=False, signals=SIGNALS, **other):
    """The ego on its approach, and an eastbound vehicle west of the junction."""
    vehicles = np.array([car(-25.0, 2.0, EAST, **other), car(2.0, ego_y, NORTH)])
    rewards = RewardPair(0.45, -0.4)
    return render.Scene(vehicles, 1, np.array([braking, False]), signals, rewards, 3.0, "wait")


def has(image, color):
    """Positions of the pixels of exactly this colour."""
    return (image == np.rint(255 * np.array(matplotlib.colors.to_rgb(color)))).all(axis=-1)


def middle(image, color, rows=slice(0, 600)):
    return [float(place.mean()) for place in np.nonzero(has(image[rows], color))]


@pytest.fixture(scope="module")
def plain():
    return pixels(sheet.picture(scene(), VIEW))


@pytest.fixture(scope="module")
def episode():
    return [scene(), scene(ego_y=40.0), scene(ego_y=34.0, crashed=True)]


@pytest.fixture(scope="module")
def frames(episode):
    """Expected frames of the episode's film: a newly drawn picture of each scene."""
    return [pixels(sheet.picture(one, VIEW)) for one in episode]


def test_a_picture_is_a_quarter_higher_than_wide(plain):
    assert plain.shape == (750, 600, 3)
    assert pixels(sheet.picture(scene(), VIEW, 4.0)).shape == (500, 400, 3)


def test_the_ego_comes_from_the_bottom_and_drives_on_the_right(plain):
    bare = plain.copy()
    bare[:200, 300:] = 0  # the legend
    row, column = middle(bare, EGO)
    assert row > 480
    assert 305 < column < 320
    nearer = pixels(sheet.picture(scene(ego_y=20.0), VIEW))
    nearer[:200, 300:] = 0
    assert middle(nearer, EGO)[0] < row - 100


def test_the_windscreen_is_in_front(plain):
    bare = plain[480:600, 290:330]
    assert middle(bare, shapes.HEADLIGHT)[0] < middle(bare, EGO)[0]


@pytest.mark.parametrize(
    ("change", "color"),
    [
        ({"yielding": True}, shapes.RED),
        ({"braking": True}, shapes.RED),
        ({"crashed": True}, shapes.BURST),
    ],
)
def test_marks_lie_by_the_car(change, color, plain):
    marked = pixels(sheet.picture(scene(**change), VIEW))
    assert has(marked, color).sum() > has(plain, color).sum() + 10
    rows, columns = np.nonzero((marked != plain).any(axis=-1))
    # The car is drawn around row 278, column 153.
    assert rows.min() > 240
    assert rows.max() < 330
    assert columns.min() > 100
    assert columns.max() < 200


def test_yielding_and_braking_look_different():
    marks = [pixels(sheet.picture(scene(**{name: True}), VIEW)) for name in ("yielding", "braking")]
    assert not np.array_equal(*marks)


def test_speeds_and_signals_show(plain):
    faster = pixels(sheet.picture(scene(speed=9.5), VIEW))
    assert (faster[:600] != plain[:600]).any()
    assert np.array_equal(faster[600:], plain[600:])
    earning = pixels(sheet.picture(scene(signals={**SIGNALS, "progress": 0.1}), VIEW))
    assert (earning[610:] != plain[610:]).any()
    assert np.array_equal(earning[:600], plain[:600])


def test_signals_of_the_two_rewards_have_their_own_colours(plain):
    panel = plain[640:]
    for color, columns in ((EGO, slice(0, 300)), (OTHER, slice(300, 600))):
        assert has(panel, color).sum() == has(panel[:, columns], color).sum() > 100


def test_vehicles_out_of_sight_are_not_drawn():
    counts = []
    for x in (-25.0, -90.0):
        made = scene()
        made.vehicles["x"][0] = x
        counts.append(has(pixels(render.filmstrip([made], VIEW)), OTHER).sum())
    assert counts[0] > counts[1] == 0


@pytest.mark.parametrize(("destination", "arrow"), [(1, (-36, -2)), (2, (2, -36)), (3, (36, 2))])
def test_the_route_ends_where_the_ego_arrives(destination, arrow):
    made = scene()
    made.vehicles["destination"] = destination
    figure = render.filmstrip([made], VIEW)
    image = pixels(figure)
    x, y = figure.axes[0].transData.transform(arrow)
    there = image[round(image.shape[0] - y), round(x)]
    assert matplotlib.colors.to_hex(there / 255) == shapes.ROUTE


def test_ways_lie_on_the_lanes():
    assert shapes.way(LANES[STRAIGHT])[[0, -1]].tolist() == [[2.0, 11.0], [2.0, -11.0]]
    for record in LANES:
        line = shapes.way(record)
        steps = np.hypot(*np.diff(line, axis=0).T)
        assert steps.max() <= 0.5
        assert steps.sum() == pytest.approx(record["length"], rel=1e-3)


def test_a_filmstrip_has_one_axes_for_each_scene():
    for scenes, grid in ((1, (1, 1)), (6, (2, 3))):
        figure = render.filmstrip([scene()] * scenes, VIEW)
        assert [axes.get_title() for axes in figure.axes] == ["t = 3.0 s"] * scenes
        spec = figure.axes[0].get_subplotspec().get_gridspec()
        assert (spec.nrows, spec.ncols) == grid
    titled = render.filmstrip([scene()] * 2, VIEW, ["start", "Go"])
    assert [axes.get_title() for axes in titled.axes] == ["start", "Go"]


def test_a_gif_has_the_pictures_in_order(tmp_path, episode, frames):
    sheet.save(tmp_path / "film.gif", episode, VIEW, 5)
    assert [path.name for path in tmp_path.iterdir()] == ["film.gif"]
    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 3
        for number, frame in enumerate(frames):
            film.seek(number)
            assert film.info["duration"] == (200, 200, 1500)[number]
            image = np.asarray(film.convert("RGB"))
            assert abs(image.astype(int) - frame).mean() < 1
            for color in (shapes.ASPHALT, shapes.PAINT, shapes.RED, shapes.BURST):
                assert has(image, color)[has(frame, color)].all()


def test_a_film_that_fails_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "film.gif"
    path.write_bytes(b"old")

    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(sheet, "_gif", fail)
    with pytest.raises(KeyboardInterrupt):
        sheet.save(path, [scene()], VIEW)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("name", "scenes", "rate", "message"),
    [
        ("film.avi", 1, 10, "choose a .gif or .mp4"),
        ("film", 1, 10, "choose a .gif or .mp4"),
        ("film.gif", 0, 10, "at least one scene"),
        ("film.gif", 1, 0, "between 1 and 50"),
        ("film.gif", 1, 51, "between 1 and 50"),
        ("nowhere/film.gif", 1, 10, "make it first"),
    ],
)
def test_mistakes_are_refused(name, scenes, rate, message, tmp_path):
    with pytest.raises(UserError, match=message):
        sheet.save(tmp_path / name, [scene()] * scenes, VIEW, rate)
    assert list(tmp_path.iterdir()) == []


def ffmpeg(folder: Path, script: str) -> None:
    program = folder / "ffmpeg"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """The only folder on the PATH."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    return folder


def test_mp4_without_ffmpeg_is_refused(tmp_path, programs):
    with pytest.raises(UserError, match=r"choose a \.gif, or install ffmpeg"):
        sheet.save(tmp_path / "film.mp4", [scene()], VIEW)
    assert not (tmp_path / "film.mp4").exists()


def test_ffmpeg_gets_every_picture(tmp_path, programs, episode, frames):
    ffmpeg(programs, 'for last; do :; done; /bin/cat > "$last"')
    sheet.save(tmp_path / "film.mp4", episode, VIEW)
    raw = np.frombuffer((tmp_path / "film.mp4").read_bytes(), np.uint8).reshape(3, 750, 600, 4)
    assert np.array_equal(raw[..., :3], np.stack(frames))


def test_a_failing_ffmpeg_is_reported(tmp_path, programs):
    ffmpeg(programs, "exit 1")
    with pytest.raises(UserError, match=r"ffmpeg failed: choose a \.gif"):
        sheet.save(tmp_path / "film.mp4", [scene()], VIEW)
    assert not (tmp_path / "film.mp4").exists()
