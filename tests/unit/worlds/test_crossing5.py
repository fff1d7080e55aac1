from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from socialiq.mdp.solve import greedy_policy, value_iteration
from socialiq.social.angle import exact_weights, score, weights
from socialiq.types import Ending
from socialiq.worlds.crossing5 import CONFLICT
from socialiq.worlds.tabular_policy import expert_policy

WAIT, GO = 0, 1
GOES_ON, ARRIVAL = Ending.NONE, Ending.ARRIVAL
ANGLES = (0.0, 45.0, 90.0)
THESIS = ("GGGG", "WGGGG", "WWWWGGGG")


def sequence(table, policy):
    """The actions of one episode, as in Fig 6.1."""
    state, taken = int(table.mdp.initial.argmax()), ""
    for _ in range(table.world.horizon):
        action = int(policy[state].argmax())
        taken += "WG"[action]
        if table.mdp.ending[state, action, 0] != Ending.NONE:
            break
        state = table.mdp.successor[state, action, 0]
    return taken


def sequences(table, weigh=weights, prefer: Any = "first"):
    solved = (
        value_iteration(table.mdp, score(weigh(angle), table.mdp.rewards), 0.99) for angle in ANGLES
    )
    return tuple(sequence(table, greedy_policy(each.q, prefer=prefer)) for each in solved)


@pytest.mark.parametrize(("angle", "expected"), list(zip(ANGLES, THESIS, strict=True)))
def test_experts_are_those_of_fig_6_1(angle, expected, table5):
    assert sequence(table5, expert_policy(table5, angle)) == expected


@pytest.mark.parametrize("arrival", ["added", "override"])
@pytest.mark.parametrize(
    ("options", "prefer", "expected"),
    [
        ({}, "first", THESIS),
        ({}, "last", ("GGGG", "GWGGG", "GWGGG")),
        ({"social_cost": "always"}, "first", ("GGGG", "WGGGG", "WGGGG")),
        ({"ends_on": "both_arrived"}, "first", ("GGGGW", "WGGGG", "WWWWGGGG")),
        ({"ends_on": "both_arrived"}, "last", ("GGGGG", "GGGGG", "GWGGG")),
        (
            {"ends_on": "time_limit"},
            "first",
            ("GGGG" + 16 * "W", "WGGGG" + 15 * "W", "WWWWGGGG" + 12 * "W"),
        ),
        ({"ends_on": "time_limit"}, "last", (20 * "G", 20 * "G", "GW" + 18 * "G")),
    ],
)
def test_sequences_of_each_reading(options, prefer, expected, arrival, tabulated):
    table = tabulated("crossing5", arrival=arrival, **options)
    assert sequences(table, prefer=prefer) == expected


@pytest.mark.parametrize("ends_on", ["ego_arrival", "both_arrived", "time_limit"])
def test_with_exact_cosine_the_altruist_never_goes(ends_on, tabulated):
    table = tabulated("crossing5", ends_on=ends_on)
    assert sequences(table, exact_weights)[2] == 20 * "W"
    assert sequences(table, exact_weights)[:2] == sequences(table)[:2]


def test_with_exact_cosine_and_ties_to_go_the_altruist_goes(table5):
    assert sequences(table5, exact_weights, "last") == ("GGGG", "GWGGG", "GWGGG")


def test_starts_with_both_at_their_edges(table5):
    assert table5.world.start == (((0, 2, 2, 0), 1.0),)
    assert table5.mdp.n_states == 25
    assert table5.world.horizon == 20


@pytest.mark.parametrize(
    ("state", "action", "after", "env", "social", "ending"),
    [
        # both are under way
        ((0, 2, 2, 0), GO, (1, 2, 2, 1), -1.0, -1.0, GOES_ON),
        ((0, 2, 2, 0), WAIT, (0, 2, 2, 1), -1.0, -1.0, GOES_ON),
        # the ego enters the conflict cell, or stands on it: the other holds
        ((1, 2, 2, 1), GO, (2, 2, 2, 1), -1.0, -1.0, GOES_ON),
        ((2, 2, 2, 1), WAIT, (2, 2, 2, 1), -1.0, -1.0, GOES_ON),
        # the ego leaves the conflict cell as the other enters it
        ((2, 2, 2, 1), GO, (3, 2, 2, 2), -1.0, -1.0, GOES_ON),
        # the other leaves it as the ego enters, and is not called back
        ((1, 2, 2, 2), GO, (2, 2, 2, 3), -1.0, -1.0, GOES_ON),
        # the other waits for no other
        ((1, 2, 2, 1), WAIT, (1, 2, 2, 2), -1.0, -1.0, GOES_ON),
        # arrivals: +10 and that step's -1; then the other is no longer charged
        ((0, 2, 2, 3), WAIT, (0, 2, 2, 4), -1.0, 9.0, GOES_ON),
        ((0, 2, 2, 4), WAIT, (0, 2, 2, 4), -1.0, 0.0, GOES_ON),
        ((3, 2, 2, 0), GO, (4, 2, 2, 1), 9.0, -1.0, ARRIVAL),
        ((3, 2, 2, 3), GO, (4, 2, 2, 4), 9.0, 9.0, ARRIVAL),
    ],
)
def test_transitions_played_by_hand(state, action, after, env, social, ending, table5, play):
    assert play(table5, state, action) == (after, env, social, ending)


@pytest.mark.parametrize(
    ("options", "state", "after", "env", "social", "ending"),
    [
        ({"arrival": "override"}, (3, 2, 2, 3), (4, 2, 2, 4), 10.0, 10.0, ARRIVAL),
        ({"social_cost": "always"}, (0, 2, 2, 4), (1, 2, 2, 4), -1.0, -1.0, GOES_ON),
        ({"ends_on": "both_arrived"}, (3, 2, 2, 2), (4, 2, 2, 3), 9.0, -1.0, GOES_ON),
        ({"ends_on": "both_arrived"}, (3, 2, 2, 3), (4, 2, 2, 4), 9.0, 9.0, ARRIVAL),
        # once there, the ego neither moves nor pays nor arrives again
        ({"ends_on": "both_arrived"}, (4, 2, 2, 2), (4, 2, 2, 3), 0.0, -1.0, GOES_ON),
        ({"ends_on": "time_limit"}, (3, 2, 2, 3), (4, 2, 2, 4), 9.0, 9.0, GOES_ON),
        ({"ends_on": "time_limit"}, (4, 2, 2, 4), (4, 2, 2, 4), 0.0, 0.0, GOES_ON),
    ],
)
def test_options_played_by_hand(options, state, after, env, social, ending, tabulated, play):
    table = tabulated("crossing5", **options)
    assert play(table, state, GO) == (after, env, social, ending)


def test_speed_is_the_distance_moved(tabulated):
    table = tabulated("crossing5", ends_on="time_limit")
    on_road = table.states[:, 0] < 4
    np.testing.assert_array_equal(table.speed[on_road], [[0.0, 1.0]] * 20)
    np.testing.assert_array_equal(table.speed[~on_road], [[0.0, 0.0]] * 5)


@pytest.mark.parametrize("reach", [(1,), (0, 1), (0, 1, 2)])
def test_a_zone_gives_the_sequences_of_fig_6_1_too(reach, table5):
    """The other car's steps are charged only while the ego is in the zone and it is in reach."""
    ego, other = table5.states[:, 0], table5.states[:, 3]
    in_zone = np.isin(ego, (CONFLICT - 1, CONFLICT)) & np.isin(other, reach)
    social = (
        10.0 * table5.signals["other_arrival"] - table5.signals["other_step"] * in_zone[:, None]
    )
    assert (social != table5.mdp.rewards.social).any()
    rewards = table5.mdp.rewards._replace(social=social)
    zoned = replace(table5, mdp=replace(table5.mdp, rewards=rewards))
    assert sequences(zoned) == THESIS
