"""The census of made-up drivers, by hand."""

import math

import numpy as np
import pytest

from socialiq_recordings.census import circular_sd, picture, population_of
from socialiq_recordings.identity.identify import Identified


def driver(recording, r_env, r_social, **more):
    angle = math.degrees(math.atan2(r_social, r_env)) if r_env or r_social else None
    fields = {
        "identity": 1,
        "decisions": 2,
        "seconds": 2.0,
        "ending": "truncated",
        "low": None,
        "high": None,
        "speed": 5.0,
        "yielding": 0.0,
        "disruption": 0.0,
        "residual": 0.5,
    }
    head = {"recording": recording, "r_env": r_env, "r_social": r_social, "angle": angle}
    return head | fields | more


def identified(*names, chains=None):
    none = tuple(np.zeros(0, np.int64) for _ in names)
    return Identified(names, names, chains or names, (), none)


NAMES = "a", "b", "c"
POINTS = [("a", 0.2, 0.1), ("a", 0.5, -1.0), ("b", -2.0, -5.0), ("c", 0.2, 0.2), ("c", 0.0, 0.4)]


@pytest.fixture
def drivers():
    return [driver(*point) for point in POINTS]


def test_the_population_counts_every_driver_once(drivers):
    found = population_of(drivers, identified(*NAMES))
    points = np.array([point[1:] for point in POINTS])
    assert (found["r_env"], found["r_social"]) == pytest.approx(tuple(points.mean(axis=0)))
    assert (found["sd_env"], found["sd_social"]) == pytest.approx(tuple(points.std(axis=0, ddof=1)))
    angle = math.degrees(math.atan2(points[:, 1].mean(), points[:, 0].mean()))
    for interval in (found["over_drivers"], found["over_chains"]):
        assert interval["estimate"] == pytest.approx(angle)
        assert interval["low"] <= angle <= interval["high"]
    assert (found["drivers"], found["recordings"], found["with_direction"]) == (5, 3, 0)


def test_recordings_count_as_units_where_drivers_of_one_are_alike():
    """Ten copies of a driver say no more than one."""
    names = [f"r{n}" for n in range(6)]
    alike = [
        driver(name, 1.0, math.tan(math.radians(10 * n)))
        for n, name in enumerate(names)
        for _ in range(10)
    ]
    found = population_of(alike, identified(*names))
    intervals = found["over_drivers"], found["over_chains"]
    widths = [interval["high"] - interval["low"] for interval in intervals]
    assert 2.0 < widths[1] / widths[0] < 4.5  # sqrt(10) = 3.2
    alone = population_of(alike, identified(*names, chains=("one",) * 6))
    assert alone["over_chains"] is None and alone["chains"] == 1


def test_those_who_stand_are_also_left_out():
    standing = driver("a", 0.0, 1.0, speed=0.1)
    found = population_of([standing, driver("a", 1.0, 0.0)], identified("a"))
    assert found["standing"] == 1
    assert found["of_the_moving"]["estimate"] == pytest.approx(0.0)
    assert population_of([standing], identified("a"))["of_the_moving"] is None


def test_circular_sd_by_hand():
    assert circular_sd(np.radians([10.0, 10.0])) == pytest.approx(0.0, abs=1e-5)
    length = math.cos(math.radians(30))
    expected = math.degrees(math.sqrt(-2 * math.log(length)))
    assert circular_sd(np.radians([-30.0, 30.0])) == pytest.approx(expected)
    assert circular_sd(np.radians([150.0, -150.0])) == pytest.approx(expected)


def test_the_same_seed_gives_the_same_intervals(drivers):
    assert population_of(drivers, identified(*NAMES), 4) == population_of(
        drivers, identified(*NAMES), 4
    )
    assert population_of(drivers, identified(*NAMES), 4) != population_of(
        drivers, identified(*NAMES), 5
    )


def test_the_picture_has_points_and_angles(drivers):
    drivers.append(driver("c", 0.0, 0.0, ending="arrival", speed=0.0))
    drivers.append(driver("c", 1.0, 0.0, low=-5.0, high=5.0, decisions=3))
    drawing = picture(drivers, population_of(drivers, identified(*NAMES)))
    left, right = drawing.axes
    labels = [text.get_text() for text in left.get_legend().get_texts()]
    assert any(label.startswith("left the view (") for label in labels)
    assert any(label.startswith("mean: ") and "over chains" in label for label in labels)
    assert "no interval (5)" in [text.get_text() for text in right.get_legend().get_texts()]
