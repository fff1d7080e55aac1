"""Effects of drivers at the crossing made by hand: known answers."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.extras.recorded_world.conftest import STARTS

from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.profile.profile import measured_in
from socialiq.cli.main import main
from socialiq.evaluation.effects import QUANTITIES, Effects, measure, measuring
from socialiq.evaluation.simulate import actor_of
from socialiq.types import Ending
from socialiq_recordings.world.effects import Episodes, _driven, _End
from socialiq_recordings.world.recorded_world import RecordedWorld

SEEDS = np.arange(64)


def effects_of(world: RecordedWorld, name: str, **options) -> Effects:
    return measure(measuring(world, **options), world.driver(name), SEEDS)


def causes_nothing(effects: Effects) -> bool:
    largest = max(np.abs(effects.delay).max(), np.abs(effects.braking).max())
    moved = effects.helped.any() or effects.harmed.any()
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
    delay, of_go, of_wait = (row.delay.sum(axis=1) for row in (driver, go, wait))
    assert of_wait.mean() > delay.mean() and of_go.mean() >= delay.mean()
    assert wait.harmed.sum() > 0 and go.totals.social.mean() < driver.totals.social.mean()
    struck = go.ending == int(Ending.COLLISION)
    assert struck.any() and of_go[struck].mean() > 0
    assert np.isfinite(go.gap).any() and (go.gap >= 0).all()


@pytest.mark.parametrize("name", ["go", "wait", "driver"])
def test_the_episode_driven_again_is_the_episode(world: RecordedWorld, name: str) -> None:
    batch = measuring(world).batch(len(SEEDS))
    actor, running, levels = actor_of(batch, world.driver(name)), np.ones(len(SEEDS), bool), []
    batch.reset(SEEDS)
    ending = np.zeros(len(SEEDS), np.int64)
    for _ in range(3):
        action = np.broadcast_to(actor.decide(batch.observation, running), len(SEEDS))
        levels.append(batch.levels[action])
        ending = np.maximum(ending, batch.step(action, auto_reset=False, rows=running).ending)
        running &= ending == 0
    steps = batch.traffic.step - batch.traffic.begun
    whole = np.flatnonzero(steps == 30)
    assert len(whole) >= 10
    episodes = Episodes(SEEDS.astype(np.uint64), np.array(levels).T, steps + 1, ending)
    end = _End(30, 10, 1, True, world.max_speed, world.config.slack)
    place = _driven(batch, episodes, True, end).place[whole]
    along, there = batch.traffic.along[whole], batch.traffic.status[whole] == 1
    there &= np.isfinite(place)
    assert there.any() and np.array_equal(place[there], along[there])


def test_an_audit_measures_what_the_command_does(world_file: Path, world: RecordedWorld) -> None:
    """A declaration may bound the effects; they are those of the policy's episodes."""
    assert set(measured_in(str(world_file))) == set(QUANTITIES)
    course = Course(world, SEEDS, 16, measured=QUANTITIES)
    driver = course.drive(Reference("wait", world.driver("wait")))
    effects = effects_of(world, "wait")
    assert np.array_equal(driver.beside["delay"], effects.delay.sum(axis=1))
    assert np.array_equal(driver.beside["gap_below_1_s"], effects.gap < 1.0)
    assert np.array_equal(driver.totals[:, 0], effects.totals.env)


def test_a_vehicle_behind_loses_what_it_would_have_driven(world: RecordedWorld) -> None:
    """The vehicle behind an ego that waits stops before it; without the ego it reaches its end."""
    effects = effects_of(world, "wait", horizon=world.config.duration)
    south, behind = 1, 2
    end = world.road.line_first[behind + 1] - world.road.line_first[behind] - 2.0
    batch = world.batch(len(SEEDS))
    batch.reset(SEEDS)
    egos = batch.traffic.ego == south
    stopped = batch.traffic.along[:, south] + batch.traffic.speed[:, south] ** 2 / 8.0
    offset = STARTS["behind"] - STARTS["south"]  # of the coordinates on the two ways
    gap = effects.delay[egos, 0] - (end - stopped[egos] - offset)
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
    assert "charged" not in rows[0] and "charges and credits" not in capsys.readouterr().out
    assert len(episodes) == 16
    assert main(["effects", str(tmp_path / "none.safetensors"), "--policy", "go"]) == 2
    assert main(["effects", str(world_file), *drivers, "--horizon", "5"]) == 2
    assert "horizon must be at least" in capsys.readouterr().err
