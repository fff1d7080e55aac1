import pytest

from socialiq.cli.drivers import driver_of
from socialiq.cli.evaluate import pool, target_of
from socialiq.worlds.intersection.world import Intersection

ROWS = [
    {"r_env": 1.0, "r_social": 0.0, "angle": 0.0, "angle_low": -1.0, "method": "exact"},
    {"r_env": 0.0, "r_social": 1.0, "angle": 90.0, "angle_low": 89.0, "method": "exact"},
]


def test_policies_of_one_angle_have_a_pooled_angle():
    assert pool(ROWS, [45.0, 45.0]) == pytest.approx({"r_env": 0.5, "r_social": 0.5, "angle": 45.0})


@pytest.mark.parametrize(
    ("targets", "why"),
    [
        ([0.0, 90.0], "the policies were trained for 0, 90 degrees"),
        ([0.0, None], "it is not known whether the policies were trained for one angle"),
        ([None, None], "it is not known whether the policies were trained for one angle"),
    ],
)
def test_policies_of_different_angles_have_none(targets, why):
    assert pool(ROWS, targets) == {"r_env": 0.5, "r_social": 0.5, "angle_not_pooled": why}


def test_targets():
    for name, angle in (("set_prosocial", 45.0), ("atlas:set_prosocial", 45.0), ("go", None)):
        assert target_of(driver_of(name, Intersection()).record) == angle


def test_a_regret_at_several_angles_is_not_pooled():
    rows = [row | {"target_angle": row["angle"], "regret": 1.0} for row in ROWS]
    assert not {"regret", "target_angle"} & pool(rows, [0.0, 90.0]).keys()
    alike = [row | {"target_angle": 45.0, "regret": 1.0} for row in ROWS]
    assert pool(alike, [45.0, 45.0])["regret"] == 1.0
