"""Grammar of drivers: rules, files, turns of a dial, front ends."""

import random

import numpy as np
import pytest

from socialiq.cli.drivers import dial_of
from socialiq.errors import UserError
from socialiq.evaluation.episodes import episodes_of
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.policies.drivers import Driver, driver_of, parse
from socialiq.storage import is_file
from socialiq.worlds.grammar import build

PARSED = {
    "gap_3s": Driver("gap_3s"),
    "atlas:prosocial": Driver("atlas:prosocial"),
    "dial.safetensors@60": Driver("dial.safetensors", 60.0),
    "dial.safetensors@60/30+latency=1,track=3": Driver(
        "dial.safetensors", 60.0, 30.0, "latency=1,track=3"
    ),
    "prosocial+known,exit=own": Driver("prosocial", front_end="known,exit=own"),
    "python:mine.py:NAME+latency=1": Driver("python:mine.py:NAME", front_end="latency=1"),
    "process:./drive --at a@1 +x=1": Driver("process:./drive --at a@1 +x=1"),
    "mail@example": Driver("mail@example"),
    "a+b": Driver("a+b"),
}


@pytest.fixture
def dial(tmp_path):
    """A dial that accelerates at 0 degrees and slows down at 90."""
    weight = np.zeros((3, 72), np.float32)
    weight[-1, -2] = weight[0, -1] = 1.0
    path = tmp_path / "dial.safetensors"
    DialPolicy(QPolicy((weight,), (np.zeros(3, np.float32),), "relu", 1.0), 0.0, 90.0).save(path)
    return path


@pytest.mark.parametrize("text", PARSED)
def test_a_text_is_taken_apart(text):
    assert parse(text) == PARSED[text]


def test_a_file_of_this_name_is_meant_first(dial):
    odd = dial.with_name("a@45+latency=1.safetensors")
    odd.write_bytes(dial.read_bytes())
    assert parse(str(odd)) == Driver(str(odd))
    assert parse(f"{odd}@90") == Driver(str(odd), 90.0)


def test_the_turn_is_the_angle(dial):
    world = build("intersection")
    observation = world.batch(1).reset(1)
    for turn, action in ((0.0, 2), (90.0, 0)):
        for loaded in (
            driver_of(f"{dial}@{turn}", world),
            driver_of(str(dial), world, angle=turn),
            driver_of(f"{dial}@{turn}", world, angle=turn),
        ):
            assert loaded.policy.predict(observation)[0].tolist() == [action]


def test_a_front_end_of_the_driver_is_that_of_the_world():
    seeds = np.arange(40)
    late = build("intersection,late")
    policy = driver_of("prosocial+latency=1", late).policy
    behind = build("intersection,late,front_end=[latency=1]")
    own = driver_of("prosocial", behind).policy
    # fewer rows than episodes: memories of rows begin again one by one
    with_driver = episodes_of(late.batch(7), policy, seeds)
    with_world = episodes_of(behind.batch(7), own, seeds)
    without = episodes_of(late.batch(7), own, seeds)
    for columns in ("totals", "ending", "length"):  # conflicts are counted in what is shown
        ours, worlds = (getattr(rows, columns) for rows in (with_driver, with_world))
        np.testing.assert_array_equal(ours, worlds)
    assert not np.array_equal(with_driver.length, without.length)


def test_a_front_end_changes_the_hash():
    world = build("intersection")
    plain, behind = (driver_of(text, world).record for text in ("gap_3s", "gap_3s+latency=1"))
    assert behind.source == "gap_3s+latency=1"
    assert behind.sha256 != plain.sha256


@pytest.mark.parametrize(
    ("text", "angle", "says"),
    [
        ("{dial}@45", 60.0, "--angle 60 contradicts"),
        ("{dial}@abc", None, "write behind"),
        ("{dial}@4x", None, "is no number"),
        ("{dial}@400", None, "outside"),
        ("{dial}@60/100", None, "class"),
        ("gap_3s@45", None, "turns a dial"),
        ("gap_3s+latency=99", None, "latency"),
        ("gap_3s+nonsense=1", None, "nonsense"),
        ("gone", None, "unknown driver 'gone'"),
    ],
)
def test_mistakes_are_one_line(text, angle, says, dial):
    with pytest.raises(UserError) as error:
        driver_of(text.format(dial=dial), build("intersection"), angle)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_gridworld_takes_no_front_end(dial):
    with pytest.raises(UserError, match="no rule-based drivers"):
        driver_of("go", build("crossing7"))


def test_rules_drive_the_scenes():
    seeds = range(24)
    for name in ("merge", "roundabout"):
        world = build(name)
        for rule in world.drivers:
            batch = world.batch(len(seeds))
            batch.reset(seeds)
            actions = world.driver(rule).predict(batch.observation)[0]
            assert set(actions.tolist()) <= set(range(world.n_actions))
    assert "gap_3s" in build("roundabout").drivers
    assert "gap_3s" not in build("merge").drivers  # its ego has the right of way


def test_any_text_is_a_driver_or_a_mistake():
    rng, world = random.Random(3), build("intersection")
    parts = ["gap_3s", "@", "+", "/", "45", "latency=1", ",", "known", "\0", "x" * 5000, "٣", "-1"]
    for _ in range(1000):
        text = "".join(rng.choice(parts) for _ in range(rng.randrange(1, 6)))
        try:
            driver_of(text, world)
        except UserError as error:
            assert "\n" not in str(error), text


def test_a_committed_result_is_a_file_outside_of_a_checkout_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = "results/intersection-dial-clock/iterated.safetensors"
    assert is_file(text) and dial_of(f"{text}@45") is not None
    loaded = driver_of(f"{text}@45", build("intersection"))
    assert loaded.record.kind == "dial"
