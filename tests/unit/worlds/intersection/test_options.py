"""The scenario's defaults are the thesis'; unsupported values raise a one-line error."""

import dataclasses
import math

import pytest

from socialiq.errors import UserError
from socialiq.worlds import registry
from socialiq.worlds.highway.options import SIGNALS, settings_of
from socialiq.worlds.intersection.options import Options

THESIS = {
    "simulation_frequency": 10,
    "policy_frequency": 1,
    "duration": 20.0,
    "initial_vehicle_count": 5,
    "spawn_probability": 0.3,
    "destination": "left",
    "target_speeds": (0.0, 4.5, 9.0),
    "observed_vehicles": 10,
    "connected_lanes": False,
    "population": "highway_env",
    "canonical": False,
    "progress_unit": 28.0,
    "zone": "last_20_m",
    "counted": "all",
    "disruption": "dead_zone",
    "crash": "override",
    "conflict_distance": 20.0,
    "progress_weight": 2.0,
    "speed_weight": 0.5,
    "collision_weight": -2.0,
    "arrival_weight": 1.0,
    "step_weight": -0.15,
    "timeout_weight": -0.5,
    "yielding_weight": 0.2,
    "disruption_weight": -1.0,
    "neighbour_collision_weight": -5.0,
    "speed_threshold": 1.0,
    "speed_cap": 5.0,
}
NAN, INF = math.nan, math.inf


def test_defaults_are_the_thesis_scenario():
    assert dataclasses.asdict(registry.make("intersection").options) == THESIS


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"simulation_frequency": 0}, "simulation_frequency must be a whole number of at least 1"),
        ({"policy_frequency": 0}, "policy_frequency must be a whole number of at least 1, got 0"),
        ({"policy_frequency": -1}, "policy_frequency must be a whole number of at least 1"),
        ({"simulation_frequency": 7.5}, "simulation_frequency must be a whole number"),
        ({"policy_frequency": 3}, "10 is not a multiple of policy_frequency 3: choose one that is"),
        ({"policy_frequency": 20}, "10 is not a multiple of policy_frequency 20"),
        ({"simulation_frequency": 1}, "simulation_frequency must be at least 2"),
        ({"duration": 0.0}, "duration must be a positive number of seconds, got 0.0"),
        ({"duration": -1.0}, "duration must be a positive number of seconds, got -1.0"),
        ({"duration": NAN}, "duration must be a positive number of seconds, got nan"),
        ({"duration": INF}, "duration must be a positive number of seconds, got inf"),
        ({"initial_vehicle_count": 0}, "initial_vehicle_count must be a whole number of at least"),
        ({"initial_vehicle_count": 2.5}, "initial_vehicle_count must be a whole number"),
        ({"spawn_probability": 1.1}, "spawn_probability must lie between 0 and 1, got 1.1"),
        ({"spawn_probability": -0.1}, "spawn_probability must lie between 0 and 1"),
        ({"spawn_probability": NAN}, "spawn_probability must lie between 0 and 1, got nan"),
        ({"target_speeds": ()}, "target_speeds must be 2 to 8 rising speeds"),
        ({"target_speeds": (9.0,)}, "target_speeds must be 2 to 8 rising speeds"),
        ({"target_speeds": (9.0, 0.0)}, "target_speeds must be 2 to 8 rising speeds"),
        ({"target_speeds": (4.0, 4.0)}, "target_speeds must be 2 to 8 rising speeds"),
        ({"target_speeds": (0.0, NAN)}, "target_speeds must be 2 to 8 rising speeds"),
        ({"target_speeds": tuple(map(float, range(9)))}, "target_speeds must be 2 to 8 rising"),
        ({"target_speeds": (0.0, 4.0, 9.0)}, "target_speeds must be equally spaced"),
        ({"observed_vehicles": 1}, "observed_vehicles must be .*at least 2, got 1"),
        ({"progress_unit": 0.0}, "progress_unit must be positive, got 0.0"),
        ({"conflict_distance": -20.0}, "conflict_distance must be positive, got -20.0"),
        ({"speed_cap": 0.0}, "speed_cap must be positive, got 0.0"),
        ({"population": "timid"}, "'timid'.*: choose one of highway_env, thesis"),
        ({"zone": "first_20_m"}, "'first_20_m'.*: choose one of last_20_m, last_8_m"),
        ({"counted": "none"}, "'none'.*: choose one of all, cross, approaching"),
        ({"disruption": "x"}, "'x'.*: choose one of dead_zone, literal"),
        ({"crash": "x"}, "'x'.*: choose one of override, add"),
        ({"destination": "north"}, "'north'.*: choose one of right, left, straight, random"),
    ],
)
@pytest.mark.usefixtures("as_a_user_runs_it")
def test_mistakes_are_refused_in_one_line(changes, line):
    for build in (Options, lambda **options: registry.make("intersection", **options)):
        with pytest.raises(UserError, match=line) as error:
            build(**changes)
        assert "\n" not in str(error.value)


UNCHECKED = [
    *({f"{name}_weight": NAN} for name in SIGNALS),
    *({f"{name}_weight": -INF} for name in SIGNALS),
    *({name: INF} for name in ("progress_unit", "speed_cap", "conflict_distance")),
    {"speed_threshold": NAN},
    {"target_speeds": (0.0, INF)},
    {"target_speeds": (-9.0, 0.0)},
    {"observed_vehicles": 2.5},
]


@pytest.mark.parametrize("changes", UNCHECKED, ids=str)
@pytest.mark.usefixtures("as_a_user_runs_it")
def test_numbers_that_mean_nothing_are_refused(changes):
    (name,) = changes
    with pytest.raises(UserError, match=f"^{name} must be ") as error:
        Options(**changes)
    assert "\n" not in str(error.value)


def test_unknown_options_are_refused():
    line = "unknown option of intersection 'nonsense': choose one of simulation_frequency, "
    with pytest.raises(UserError, match=line):
        registry.make("intersection", nonsense=1)


def test_its_states_cannot_be_listed():
    line = (
        "states of intersection can't be listed.*: choose one of crossing5, crossing7, crosswalk7"
    )
    with pytest.raises(UserError, match=line):
        registry.make_grid("intersection")


def test_options_name_what_is_derived_from_them():
    options = Options(
        simulation_frequency=15, policy_frequency=5, duration=4.1, target_speeds=(0.0, 6.0)
    )
    assert options.frames == 3
    assert options.max_speed == 6.0
    # 4 tries before the episode, the challenger, the ego, one after each of 21 decisions and
    # one more, because the clock may round down
    assert options.capacity == 4 + 1 + 1 + 21 + 1


def test_the_core_reads_what_the_options_say():
    options = Options(
        zone="beyond_8_m",
        counted="approaching",
        disruption="literal",
        crash="add",
        destination="straight",
        population="thesis",
        target_speeds=(1.0, 3.0),
        simulation_frequency=15,
        policy_frequency=5,
        canonical=True,
        yielding_weight=7.0,
    )
    (read,) = settings_of(options)
    names = [read[name] for name in ("zone", "counted", "disruption", "crash", "destination")]
    assert names == [2, 2, 1, 1, 2]
    assert read["population"][0].tolist() == [8.0, 1.0, 5.0, 10.0]
    assert (read["n_speeds"], read["max_speed"]) == (2, 3.0)
    assert read["target_speeds"][:2].tolist() == [1.0, 3.0]
    assert (read["frames"], read["warm_up"], read["rule_period"]) == (3, 45, 7)
    assert (read["dt"], read["decision"]) == (1 / 15, 1 / 5)
    assert 0 < read["tie"] < 1e-6
    assert read["weights"][SIGNALS.index("yielding")] == 7.0
    assert settings_of(Options())[0]["tie"] == 0
