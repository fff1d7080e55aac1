"""Effects of drivers at the crossing made by hand: known answers."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.extras.recorded_world.conftest import STARTS

from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.profile.profile import measured_in
from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.evaluation.effects import QUANTITIES, measure, measuring
from socialiq.evaluation.measures import Episodes
from socialiq.learners.dial.config import OfflineDialConfig, OfflineDialHyperparameters
from socialiq.types import Ending
from socialiq.worlds.environment import make_environment
from socialiq.worlds.highway.effects import RELATIONS, REPEAT, SIGNALS
from socialiq_recordings.world.config import AS_DRIVER
from socialiq_recordings.world.practice import Practice, record, train_with_practice
from socialiq_recordings.world.recorded_world import RecordedWorld
from socialiq_recordings.world.replay import replay
from socialiq_recordings.world.traffic import PRESENT

SEEDS = np.arange(64)


def effects_of(world: RecordedWorld, name: str, **options) -> Episodes:
    return measure(measuring(world, **options), world.driver(name), SEEDS)


def causes_nothing(effects: Episodes) -> bool:
    delays = [effects[f"delay_{name}"] for name in RELATIONS]
    largest = max(np.abs(delays).max(), np.abs(effects.braking).max())
    moved = bool(effects.helped.any() or effects.harmed.any())
    moved |= not np.array_equal(effects.not_caused, effects.charged)
    moved |= bool(effects.caused.any() or effects.gained.any() or effects.lost.any())
    return bool(largest <= 1e-12 and np.isinf(effects.gap).all() and not moved)


@pytest.mark.parametrize("name", ["go", "wait", "driver"])
def test_who_meets_nobody_or_is_alone_causes_nothing(world: RecordedWorld, name: str) -> None:
    road, line = world.road, world.road.line.copy()
    line[:, 0] += 1000.0 * np.repeat(np.arange(3), np.diff(road.line_first))
    nothing = np.full_like(road.area_of, -1), np.zeros_like(road.stretch_first), road.stretch[:0]
    names = "area_of", "stretch_first", "stretch"
    apart = road._replace(line=line, **dict(zip(names, nothing, strict=True)))
    assert causes_nothing(effects_of(replace(world, road=apart), name))
    later = road._replace(state_step=road.state_step + 10**6, egos=road.egos[:1])
    later.state_step[road.egos[0]] = road.state_step[road.egos[0]]
    assert causes_nothing(effects_of(replace(world, road=later), name))
    assert not causes_nothing(effects_of(world, name))


def test_no_trivial_driver_looks_kind(world: RecordedWorld) -> None:
    driver, go, wait = (effects_of(world, name) for name in world.drivers)
    delay, of_go, of_wait = (row.delay for row in (driver, go, wait))
    assert of_wait.mean() > delay.mean() and of_go.mean() >= delay.mean()
    assert wait.harmed.sum() > 0 and go.totals.social.mean() < driver.totals.social.mean()
    struck = go.ending == int(Ending.COLLISION)
    assert struck.any() and of_go[struck].mean() > 0
    assert np.isfinite(go.gap).any() and (go.gap >= 0).all()


def test_a_look_ahead_with_the_own_action_is_the_step(world: RecordedWorld) -> None:
    batch = started(world)
    for action in (0, batch.faster, AS_DRIVER):
        state = batch.save()
        batch.measure(REPEAT + action % (batch.n_actions + 1), np.ones(batch.size, bool))
        ahead = batch.ledger.ahead[:, : world.capacity, 0].copy()
        batch.step(np.full(batch.size, action), auto_reset=False)
        whole = batch.buffers.present[:, 0] > 0
        vehicles = batch.buffers.vehicles
        there = whole[:, None] & (vehicles["status"] == PRESENT) & ~np.isnan(ahead)
        assert there.sum() > batch.size / 2
        assert np.array_equal(ahead[there], vehicles["speed"][there])
        batch.restore(state)


def test_signals_sum_to_both_worlds_and_copies_repeat_every_bit(world: RecordedWorld) -> None:
    batch = started(world)
    batch.step(np.full(batch.size, 3), auto_reset=False)
    running = np.flatnonzero(batch.running)
    copies = [batch.branch(running) for _ in range(2)]
    sums = [rewarded(copy, copy.faster) for copy in copies]
    assert len(running) > 10 and np.array_equal(sums[0], sums[1])
    first = np.stack([batch.ledger.signals[running, number] for number in range(2)], axis=1)
    apart = (copies[0].ledger.without - copies[0].ledger.driven).sum(axis=1)
    np.testing.assert_allclose((sums[0] + first)[:, 0], apart[:, 0], atol=1e-9)
    np.testing.assert_array_equal((sums[0] + first)[:, 1], -apart[:, 1])
    with pytest.raises(UserError, match="only one of state and batch measures effects"):
        world.batch(len(SEEDS)).restore(batch.save())


def started(world: RecordedWorld) -> Any:
    batch = measuring(world).batch(len(SEEDS))
    batch.reset(SEEDS)
    return batch


def rewarded(batch: Any, action: int) -> np.ndarray:
    """Drive to the end, and return the sums of the first two signals; check the rewards."""
    running, sums = batch.running, np.zeros((batch.size, 2))
    effects = batch.effects
    weights = [getattr(effects, f"{name}_weight") for name in SIGNALS]
    while running.any():
        decisions = batch.step(np.full(batch.size, action), auto_reset=False, rows=running)
        signals = np.stack([decisions.signals[name] for name in SIGNALS], axis=1)
        social = signals @ weights
        social += effects.caused_collision_weight * (decisions.ending == int(Ending.COLLISION))
        np.testing.assert_allclose(decisions.rewards.social[running], social[running], atol=1e-9)
        sums[running] += signals[running, :2]
        running &= decisions.ending == 0
    return sums


def test_a_world_that_rewards_effects_is_a_file_that_others_do_not_equal(
    world: RecordedWorld, tmp_path: Path
) -> None:
    caused = measuring(world, delay_weight=-0.2)
    sha256 = caused.save(tmp_path / "caused.safetensors")
    again = RecordedWorld.load(tmp_path / "caused.safetensors")
    assert again.effects == caused.effects and again.config == world.config
    assert sha256 != world.sha256 and again.description != world.description
    assert again.reward["social"]["delay"] == -0.2 and "yielding" in world.reward["social"]
    plain, batch = world.batch(len(SEEDS)), again.batch(len(SEEDS))
    assert np.array_equal(plain.reset(SEEDS), batch.reset(SEEDS))
    for _ in range(15):  # new episodes begin meanwhile
        action = np.arange(len(SEEDS)) % world.n_actions
        decisions, rewarded_by_eq_4_2 = batch.step(action), plain.step(action)
        assert np.array_equal(decisions.observation, rewarded_by_eq_4_2.observation)
        assert np.array_equal(decisions.rewards.env, rewarded_by_eq_4_2.rewards.env)
        assert np.array_equal(batch.observation, plain.observation)
    env = make_environment(str(tmp_path / "caused.safetensors"))
    env.reset(seed=0)
    *_, info = env.step(0)
    assert set(SIGNALS) <= info["signals"].keys()
    with pytest.raises(UserError, match="no episode without its driver"):
        replay(again)


@pytest.mark.parametrize(("more", "end"), [([], 60.0), (["--horizon", "50"], 50.0)])
def test_the_command_measures_to_the_end_of_the_file(
    world: RecordedWorld, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    more: list[str], end: float,
) -> None:  # fmt: skip
    file = tmp_path / "caused.safetensors"
    measuring(world, horizon=60.0).save(file)
    command = ["effects", str(file), "--policy", "go", "--episodes", "2", "--json"]
    assert main([*command, *more]) == 0
    assert json.loads(capsys.readouterr().out)["horizon"] == end


def test_a_dial_learns_from_what_is_caused(world: RecordedWorld) -> None:
    caused = measuring(world)
    drivers = {name: caused.driver(name) for name in ("go", "wait")}
    recorded = record(caused, drivers, 8, 0.5, 0)
    static = OfflineDialConfig(updates=20, batch_size=16, hidden=(8,))
    numbers = [OfflineDialHyperparameters(seed=0)]
    practised = train_with_practice(caused, static, numbers, recorded, Practice(1, episodes=2))
    assert practised.driven[0][0].rewards.social.min() < -0.5  # metres lost
    dial = practised.stages["dial"].policy(0).at(45.0)
    assert np.isfinite(measure(caused, dial, SEEDS[:4]).totals.social).all()
    with pytest.raises(UserError, match=r"rewards of Eq 4\.2"):
        train_with_practice(caused, static, numbers, replay(world).table, Practice(0))


def test_charges_and_credits_are_judged_by_causes(world: RecordedWorld) -> None:
    driver, go, wait = (effects_of(world, name) for name in world.drivers)
    for effects in (driver, go, wait):
        assert (effects.not_caused <= effects.charged).all()
        assert (effects.missed <= effects.caused).all()
        assert (effects.gained + effects.lost <= effects.credited).all()
    assert not (go.gained.any() or go.lost.any())  # it is what credits are compared with
    assert wait.caused.sum() > 0 and wait.lost.sum() > 0 and driver.credited.sum() > 0


def test_an_audit_measures_what_the_command_does(world_file: Path, world: RecordedWorld) -> None:
    """A declaration may bound the effects; they are those of the policy's episodes."""
    assert set(measured_in(str(world_file))) == {"delay", "braking", "gap_below_1_s"}
    course = Course(world, SEEDS, 16, measured=QUANTITIES)
    driver = course.drive(Reference("wait", world.driver("wait")))
    effects = effects_of(world, "wait")
    assert np.array_equal(driver.episodes["delay"], effects.delay)
    assert np.array_equal(driver.episodes["gap_below_1_s"], effects.gap < 1.0)
    assert np.array_equal(driver.totals[:, 0], effects.r_env)


def test_a_vehicle_behind_loses_what_it_would_have_driven(world: RecordedWorld) -> None:
    """The vehicle behind an ego that waits stops before it; without the ego it reaches its end."""
    effects = effects_of(world, "wait", horizon=world.config.duration)
    south, behind = 1, 2
    end = world.road.line_first[behind + 1] - world.road.line_first[behind] - 2.0
    batch = world.batch(len(SEEDS))
    batch.reset(SEEDS)
    egos = batch.egos == south
    vehicle = batch.buffers.vehicles[:, south]
    stopped = vehicle["along"] + vehicle["speed"] ** 2 / 8.0
    offset = STARTS["behind"] - STARTS["south"]  # of the coordinates on the two ways
    gap = effects.delay_same_approach[egos] - (end - stopped[egos] - offset)
    size = world.road.length[south] / 2 + world.road.length[behind] / 2
    assert egos.sum() > 10 and ((gap > size) & (gap < size + 8.0)).all()


def test_the_command_writes_the_effects_of_a_world_file(world_file, tmp_path, capsys) -> None:
    out = tmp_path / "effects"
    drivers = ["--policy", "go", "--policy", "driver"]
    assert main(["effects", str(world_file), *drivers, "--episodes", "8", "--out", str(out)]) == 0
    rows, episodes = (
        list(csv.DictReader((out / f"{name}.csv").read_text().splitlines()))
        for name in ("effects", "episodes")
    )
    assert [row["policy"] for row in rows] == ["go", "driver"]
    assert {"delay", "braking", "gap_below_1_s", "r_caused"} <= rows[0].keys()
    assert "missed_of_caused" in rows[0] and "of_credited" in capsys.readouterr().out
    assert len(episodes) == 16
    assert main(["effects", str(tmp_path / "none.safetensors"), "--policy", "go"]) == 2
    assert main(["effects", str(world_file), *drivers, "--horizon", "5"]) == 2
    assert "horizon must be at least" in capsys.readouterr().err
