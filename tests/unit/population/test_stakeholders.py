"""Utilities, dominated settings and bargains, with answers by hand."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.population import stakeholders as room

TWO = """
[passenger]
weight = 1.0
r_env = 1.0
[others]
weight = 1.0
delay = -0.5
"""


def constant(utilities, episodes=4):
    """Return settings that are worth the same in every episode."""
    rows = np.array(utilities, dtype=float)
    return np.repeat(rows[:, None], episodes, axis=1)


def chosen(judgement, rule):
    return int(judgement.chosen[rule].argmax())


def test_rules_choose_by_hand():
    """Worst 0 and 0: products 0, 6, 4, 0; least shares 0, .5 (2 of 4), .25, 0; sums 6, 5, 5, 4."""
    worth = constant([[6.0, 0.0], [3.0, 2.0], [4.0, 1.0], [0.0, 4.0]])
    judgement = room.judge(worth, np.ones(2), resamples=20)
    assert [chosen(judgement, rule) for rule in room.RULES] == [0, 1, 1]
    assert judgement.dominated.tolist() == [0.0] * 4
    np.testing.assert_array_equal(judgement.mean, judgement.low)


def test_weights_move_the_choices():
    worth = constant([[6.0, 0.0], [3.0, 2.0], [0.0, 4.0]])
    people = [room.Stakeholder(name, 1.0, {"r_env": 1.0}) for name in ("a", "b")]
    moved = {(name, factor): choice for name, factor, choice in room.moved_weights(worth, people)}
    assert moved["b", 4.0]["weighted_sum"] == 2
    assert moved["b", 0.25]["weighted_sum"] == 0
    assert {choice["max_min"] for choice in moved.values()} == {1}


def test_dominated_settings():
    worth = constant([[1.0, 1.0], [1.0, 2.0], [2.0, 0.0], [1.0, 2.0]])
    judgement = room.judge(worth, np.ones(2), resamples=5)
    assert judgement.dominated.tolist() == [1.0, 0.0, 0.0, 0.0]


def test_intervals_are_those_of_paired_means():
    """The settings share their episodes, so a common effect does not blur their order."""
    generator = np.random.default_rng(0)
    common = generator.normal(0.0, 10.0, 400)
    worth = np.stack([common, common + 0.1])[..., None] * np.ones(2)
    judgement = room.judge(worth, np.ones(2), resamples=400)
    assert judgement.dominated.tolist() == [1.0, 0.0]
    half = (judgement.high - judgement.low)[0, 0] / 2
    assert half == pytest.approx(1.96 * common.std() / 20, rel=0.15)


def test_files(tmp_path):
    table = tmp_path / "episodes.csv"
    table.write_text(
        "policy,angle,seed,r_env,ending,delay_behind,delay_crossing,gap\n"
        "a,0.0,1,3.0,1,1.0,2.0,0.5\na,0.0,2,5.0,2,0.0,0.0,inf\n"
        "b,,1,1.0,3,0.0,0.0,2.0\nb,,2,1.0,1,-1.0,0.0,inf\n"
    )
    people = tmp_path / "people.toml"
    people.write_text(TWO)
    episodes = room.read_episodes(table)
    assert episodes.settings == ({"policy": "a", "angle": 0.0}, {"policy": "b", "angle": ""})
    assert episodes.quantities["collision"].tolist() == [[0.0, 1.0], [0.0, 0.0]]
    assert episodes.quantities["gap_below_1_s"].tolist() == [[1.0, 0.0], [0.0, 0.0]]
    worth = room.utilities(episodes, room.read_stakeholders(people))
    assert worth.tolist() == [[[3.0, -1.5], [5.0, 0.0]], [[1.0, 0.0], [1.0, 0.5]]]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[a]\nr_env = 1.0\n", r"\[a\] needs a weight"),
        ("[a]\nweight = -1.0\nr_env = 1.0\n", r"\[a\] needs a weight"),
        ("[a]\nweight = 1.0\n", r"\[a\] cares about nothing"),
        ("[a]\nweight = 1.0\nr_env = 'x'\n", "r_env of \\[a\\] is not a finite number"),
        ("[a]\nweight = 1.0\nr_env = nan\n", "r_env of \\[a\\] is not a finite number"),
        ("[a]\nweight = 1.0\nr_env = 1.0\n", "declare two or more"),
        ("a = 1.0\n", r"write \[a\] as a table"),
        (TWO.replace("weight = 1.0", "weight = 0.0"), "every weight is 0"),
        ("nonsense", "is not TOML"),
    ],
)
def test_mistakes_in_a_declaration_are_one_line(tmp_path, text, says):
    path = tmp_path / "people.toml"
    path.write_text(text)
    with pytest.raises(UserError, match=says):
        room.read_stakeholders(path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("policy,angle\na,0\n", "no column seed"),
        ("policy,angle,seed,r_env\na,0,1,2\nb,0,2,2\n", "b 0 did not drive the episodes"),
        ("policy,angle,seed,r_env\n", "no column policy"),
        ("policy,angle,seed,r_env\na,0,1,2\nb,0,1,2\n", "delay was not measured: choose of"),
        ("policy,angle,seed,r_env,delay\na,0,1,2,inf\nb,0,1,2,1\n", "delay is not finite"),
    ],
)
def test_mistakes_in_episodes_are_one_line(tmp_path, text, says):
    path, people = tmp_path / "episodes.csv", tmp_path / "people.toml"
    path.write_text(text)
    people.write_text(TWO)
    with pytest.raises(UserError, match=says):
        room.utilities(room.read_episodes(path), room.read_stakeholders(people))
