import numpy as np
import pytest

from socialiq.mdp.front import attainable_set
from socialiq.mdp.horizon import horizon_evaluation
from socialiq.social.angle import angle_of, score, weights
from socialiq.types import Ending
from socialiq.worlds.tabular_policy import expert_policy

ANGLES = (0.0, 45.0, 90.0)


def evaluated(table, angle, variant="stochastic"):
    part = table.reachable_part()
    policy = expert_policy(part, angle, variant)
    return horizon_evaluation(part.mdp, policy, part.world.horizon)


def angles(table, variant="stochastic"):
    return [angle_of(*evaluated(table, angle, variant).totals) for angle in ANGLES]


@pytest.fixture(scope="module")
def region(table7):
    return attainable_set(table7.mdp, table7.world.horizon)


def test_sizes(table7):
    assert table7.mdp.n_states == 12_096
    assert table7.reachable_part().mdp.n_states == 276


@pytest.mark.parametrize("variant", ["deterministic", "stochastic"])
@pytest.mark.parametrize(
    ("angle", "env", "social", "found"),
    [(0.0, 2.2, -2.0, -42.27), (45.0, 1.81, 0.32, 10.03), (90.0, -7.1, 3.756, 152.12)],
)
def test_optima_are_those_of_the_thesis(angle, env, social, found, variant, table7):
    totals = evaluated(table7, angle, variant).totals
    assert totals == pytest.approx((env, social), abs=5e-4)
    assert angle_of(*totals) == pytest.approx(found, abs=5e-3)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"second_slot_refills": "same_step"}, (-42.27, 10.03, 150.9)),
        ({"arrival": "added"}, (-41.0, 9.5, 152.1)),
        ({"full_stop": "flat"}, (-34.3, 10.03, 152.1)),
        ({"first_slot": "once"}, (-42.27, 10.03, 167.6)),
        ({"first_slot": "once", "second_slot_refills": "same_step"}, (-42.27, 10.03, 166.2)),
        ({"second_slot_at_start": "random"}, (-49.8, 10.6, 152.15)),
        (
            {"second_slot_at_start": "random", "second_slot_refills": "same_step"},
            (-49.8, 10.6, 150.9),
        ),
        ({"yield_zone": "with_conflict"}, (-42.27, 144.05, 144.05)),
        ({"braking": "one_level"}, (10.03, 10.03, 152.1)),
        ({"slow_yield": "full"}, (-42.27, 10.03, 152.1)),
        ({"conflict": "end_cell"}, (0.0, 3.26, 152.1)),
    ],
    ids=lambda value: "-".join(value.values()) if isinstance(value, dict) else "",
)
def test_optimal_angles_of_each_reading(options, expected, tabulated):
    assert angles(tabulated("crossing7", **options)) == pytest.approx(expected, abs=0.06)


def test_yielding_on_the_conflict_cell_is_a_reward_hack(tabulated):
    table = tabulated("crossing7", yield_zone="with_conflict").reachable_part()
    result = horizon_evaluation(table.mdp, expert_policy(table, 90.0, "stochastic"), 25)
    assert result.totals == pytest.approx((-6.9, 5.0), abs=5e-3)
    on_the_cell = table.states[:, 0] == 3
    assert result.visits[on_the_cell].sum() > 20.0
    assert result.endings[Ending.TIMEOUT] == pytest.approx(1.0)


def test_the_prosocial_expert_of_the_deterministic_variant_hacks_too(tabulated):
    table = tabulated("crossing7", yield_zone="with_conflict")
    assert angles(table, "deterministic") == pytest.approx((-42.27, 133.3, 144.05), abs=0.06)


@pytest.mark.parametrize(
    ("angle", "env", "social", "value"),
    [
        (0, 2.200, -2.000, 2.200),
        (5, 2.200, -2.000, 2.017),
        (10, 1.990, -0.460, 1.880),
        (15, 1.810, 0.320, 1.831),
        (20, 1.810, 0.320, 1.810),
        (25, 1.810, 0.320, 1.776),
        (30, 1.810, 0.320, 1.728),
        (35, 1.810, 0.320, 1.666),
        (40, 1.810, 0.320, 1.592),
        (45, 1.810, 0.320, 1.506),
        (50, 1.810, 0.320, 1.409),
        (55, 1.810, 0.320, 1.300),
        (60, 1.558, 0.488, 1.202),
        (62, 0.139, 1.261, 1.178),
        (63, -2.244, 2.510, 1.218),
        (64, -3.383, 3.077, 1.283),
        (65, -3.849, 3.298, 1.362),
        (70, -4.141, 3.420, 1.798),
        (75, -4.141, 3.420, 2.232),
        (80, -4.547, 3.501, 2.659),
        (85, -5.905, 3.665, 3.137),
        (90, -7.100, 3.756, 3.756),
    ],
)
def test_best_value_of_every_angle(angle, env, social, value, region):
    best = region.optimum(float(angle))
    assert best.point == pytest.approx((env, social), abs=6e-4)
    assert best.value == pytest.approx(value, abs=6e-4)


@pytest.mark.parametrize(
    ("angle", "radius"),
    [
        (0, 1.884),
        (15, 1.691),
        (30, 1.376),
        (45, 1.224),
        (60, 1.174),
        (75, 1.2077),
        (90, 1.334),
        (-30, 2.416),
        (-45, 3.064),
        (120, 2.219),
        (150, 7.418),
    ],
)
def test_largest_attainable_radius(angle, radius, region):
    assert region.radius(float(angle)) == pytest.approx(radius, abs=6e-4)


def test_the_front_jumps_from_crossing_to_waiting_between_60_and_65_degrees(region):
    before, after = (region.optimum(angle).point for angle in (60.0, 65.0))
    assert angle_of(*before) == pytest.approx(17.4, abs=0.05)
    assert angle_of(*after) == pytest.approx(139.4, abs=0.05)
    steps = [angle_of(*region.optimum(float(angle)).point) for angle in range(91)]
    assert 60 <= int(np.diff(steps).argmax()) < 65


@pytest.mark.parametrize(
    ("angle", "value"), [(60.0, 1.202), (65.0, 0.404), (70.0, 1.101), (75.0, 1.790), (85.0, 3.123)]
)
def test_stationary_optima_lose_where_the_last_steps_matter(angle, value, table7):
    totals = evaluated(table7, angle).totals
    assert score(weights(angle), totals) == pytest.approx(value, abs=6e-4)


@pytest.mark.parametrize("angle", ANGLES)
def test_no_optimum_collides(angle, table7):
    endings = evaluated(table7, angle).endings
    assert endings[Ending.COLLISION] == 0.0
    assert endings[Ending.ARRIVAL] == pytest.approx(1.0 if angle < 90.0 else 0.0)
