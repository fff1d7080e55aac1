import numpy as np
import pytest

from socialiq_recordings.conflicts.yielding import Stakes, recovered, weight, who_yields


def rows_of(ego, other, ego_class, other_class, first, losses, pet):
    row = {"recording": "a", "ego": ego, "other": other, "ego_class": ego_class}
    row |= {"other_class": other_class, "ego_first": first, "pet": pet}
    row |= {"ego_lost": losses[0], "other_lost": losses[1]}
    back = row | {"ego": other, "other": ego, "ego_class": other_class, "other_class": ego_class}
    back |= {"ego_first": not first, "ego_lost": losses[1], "other_lost": losses[0]}
    return [row, back]


def test_who_passes_second_and_loses_a_second_gave_way():
    conflicts = [
        *rows_of(1, 2, "car", "pedestrian", False, (1.5, 0.1), 1.0),
        *rows_of(4, 3, "pedestrian", "bus", False, (2.0, 1.2), 2.0),
        *rows_of(5, 6, "car", "pedestrian", True, (0.0, 0.4), 3.0),
        *rows_of(7, 8, "car", "pedestrian", True, (None, None), None),
        *rows_of(9, 10, "bicycle", "bicycle", True, (0.0, 1.0), 2.0),
    ]
    of_bicycles, of_walkers = sorted(who_yields(conflicts), key=lambda row: row["of"])
    counts = {"conflicts": 4, "with_pet": 3, "median_pet": 2.0, "ordered": 3, "of_first": 2}
    counts |= {"of_yielded": 1, "to_yielded": 1, "first_lost": 1}
    assert of_walkers == {"of": "vehicle", "to": "pedestrian"} | counts
    assert (of_bicycles["of_yielded"], of_bicycles["to_yielded"]) == (1, None)


def drawn(angle):
    """800 contested conflicts of drivers whose weights have an angle."""
    random = np.random.default_rng(3)
    own, other = random.uniform(0.1, 5.0, (2, 800))
    gain = np.sin(np.radians(angle)) * other - np.cos(np.radians(angle)) * own
    second = random.random(800) < 1 / (1 + np.exp(-1.5 * gain))
    return [Stakes(*row) for row in zip(own.tolist(), other.tolist(), second.tolist(), strict=True)]


@pytest.mark.parametrize("angle", [25.0, 60.0])
def test_a_known_weight_is_recovered_from_many_contested_conflicts(angle):
    estimate = weight(drawn(angle), np.arange(800) % 40)
    assert estimate.low <= angle <= estimate.high and estimate.high - estimate.low < 12
    assert estimate.sharpness == pytest.approx(1.5, rel=0.25)


def test_waits_of_many_contested_conflicts_tell_angles_apart():
    ranges = {true: (low, high) for true, low, high in recovered(drawn(25.0), 1.5, draws=20)}
    assert ranges[30.0][0] > 20 and ranges[60.0][1] < 70


def test_few_contested_conflicts_give_no_weight():
    stakes = [Stakes(1.0, 0.0, False)] * 500 + [Stakes(1.0, 2.0, True)] * 19
    assert weight(stakes, np.arange(519) % 9) is None
    low, high = next((low, high) for _, low, high in recovered(stakes[-5:]))
    assert high - low > 45  # five cannot tell 30 degrees from others
