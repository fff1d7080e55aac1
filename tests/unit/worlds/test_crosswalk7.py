import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import ByClass, Ending
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make, make_grid

STOP, SLOW, FAST = 0, 1, 2
INSISTS = 4  # chance outcome in which an impatient pedestrian walks; no user arrives
ARRIVES = 2


@pytest.fixture(scope="module")
def world():
    return make_grid("crosswalk7")


def moved(world, ego, speed, waited, action, chance=0):
    """The pedestrian's next feature, the delay, the hit and the ending; vehicles are far away."""
    state = np.array([ego, speed, 5, 2, -1, 0, waited])
    outcome = world.rules(state, action, chance)
    signals = outcome.signals
    names = ("pedestrian_delay", "pedestrian_hit")
    return int(outcome.state[-1]), *(float(signals[name]) for name in names), int(outcome.ending)


GOES_ON, HIT = int(Ending.NONE), int(Ending.COLLISION)


@pytest.mark.parametrize(
    ("ego", "speed", "waited", "action", "chance", "after"),
    [
        (0, FAST, 0, STOP, 0, (0, 0, 0, GOES_ON)),  # no pedestrian
        (0, FAST, 0, STOP, ARRIVES, (1, 0, 0, GOES_ON)),
        (3, FAST, 1, STOP, 0, (2, 1, 0, GOES_ON)),  # waits for an ego that has not yet stood
        (3, STOP, 1, STOP, 0, (0, 0, 0, GOES_ON)),  # walks ahead of an ego that stands
        (3, STOP, 1, SLOW, 0, (0, 0, 1, HIT)),
        (1, SLOW, 1, SLOW, 0, (0, 0, 0, GOES_ON)),  # three cells away and slow
        (1, FAST, 1, SLOW, 0, (2, 1, 0, GOES_ON)),
        (2, SLOW, 1, FAST, 0, (2, 1, 0, GOES_ON)),
        (4, SLOW, 4, STOP, INSISTS, (4, 1, 0, GOES_ON)),  # the ego stays on the crosswalk
        (4, SLOW, 3, SLOW, INSISTS, (4, 1, 0, GOES_ON)),  # has not waited for three steps
        (4, SLOW, 4, SLOW, INSISTS, (0, 0, 0, GOES_ON)),  # walks behind the ego
        (2, FAST, 4, FAST, 0, (4, 1, 0, GOES_ON)),
        (2, FAST, 4, FAST, INSISTS, (0, 0, 1, HIT)),  # passes over the crosswalk
        (2, FAST, 4, SLOW, INSISTS, (0, 0, 0, GOES_ON)),  # stops before it
        (5, SLOW, 2, STOP, 0, (0, 0, 0, GOES_ON)),
    ],
)
def test_pedestrians_move_by_hand(ego, speed, waited, action, chance, after, world):
    assert moved(world, ego, speed, waited, action, chance) == after


def test_a_hit_is_a_collision_without_speed_and_step(world):
    signals = world.rules(np.array([3, STOP, 5, 2, -1, 0, 1]), SLOW, 0).signals
    env = {name: float(signals[name]) for name in world.env_weights}
    assert env == {"speed": 0.0, "step": 0.0, "arrival": 0.0, "collision": 1.0}
    assert float(signals["neighbour_collision"]) == 0.0


def test_waiting_for_a_pedestrian_blocks_vehicles(world):
    outcome = world.rules(np.array([3, FAST, 2, 2, -1, 0, 1]), STOP, 0)
    assert float(outcome.signals["disruption"]) == 2.0


def test_804_states_are_reachable(world):
    assert tabulate(world).reachable_part().mdp.n_states == 804


def test_weights_of_0_give_the_rewards_of_crossing7():
    table, plain = tabulate(make_grid("crosswalk7-0")), tabulate(make_grid("crossing7"))
    seen = {state.tobytes(): row for row, state in enumerate(plain.states)}
    rows = [seen[state[:-1].tobytes()] for state in table.states]
    alive = ~(table.mdp.ending == Ending.COLLISION).any(axis=2)
    social = plain.mdp.rewards.social[rows]
    np.testing.assert_array_equal(table.mdp.rewards.social, social)
    np.testing.assert_array_equal(table.mdp.rewards.env[alive], plain.mdp.rewards.env[rows][alive])


def test_r_social_weighs_the_classes_by_the_angle(world):
    signals = dict.fromkeys(world.signal_names, 0.0)
    signals |= {"disruption": 2.0, "pedestrian_delay": 1.0}
    parts = world.with_parts().rewards(signals).social
    assert parts == ByClass(vehicle=-2.0, vulnerable=-0.5)
    found = [make_grid(f"crosswalk7-{angle}").rewards(signals).social for angle in (0, 30, 90)]
    assert found == pytest.approx([-2.0, -2.0 * np.sqrt(0.75) - 0.25, -0.5], abs=1e-15)
    assert make_grid("crosswalk7", class_angle=30.0).rewards(signals).social == found[1]


def test_the_definition_of_the_reward_names_the_class_weights():
    assert make_grid("crosswalk7-90").reward["classes"] == {"vehicle": 0.0, "vulnerable": 1.0}
    assert "classes" not in make_grid("crossing7").reward


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"class_angle": 91.0}, r"class angle 91 is outside \[0, 90\] degrees"),
        ({"class_angle": float("nan")}, "class angle nan is outside"),
        ({"impatience": 1.5}, "impatience 1.5 is not a probability"),
        ({"pedestrian_probability": -0.1}, "pedestrian_probability -0.1 is not"),
    ],
)
def test_values_outside_are_refused(options, line):
    with pytest.raises(UserError, match=line):
        make("crosswalk7", **options)


def test_a_world_of_one_class_has_no_parts():
    with pytest.raises(UserError, match="crossing7 has vehicles only"):
        make_grid("crossing7").with_parts()
