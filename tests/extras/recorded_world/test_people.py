"""The crossing with a pedestrian before the car from the west, and a cyclist before the others."""

import dataclasses
import json

import gymnasium
import numpy as np
import pytest
from tests.extras.recorded_world.conftest import FRAMES, crossing_road, tracks
from tests.extras.recorded_world.test_recorded_world import resealed

from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.evaluation.shield import shielded
from socialiq.evaluation.simulate import play
from socialiq.types import Ending
from socialiq.worlds import RECORDED_JUNCTION
from socialiq.worlds.highway.effects import EffectOptions
from socialiq.worlds.highway.options import Contact
from socialiq_recordings import files
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.world.build import build
from socialiq_recordings.world.compare import contacts
from socialiq_recordings.world.config import AS_DRIVER, WorldConfig
from socialiq_recordings.world.recorded_world import RecordedWorld

GO, WAIT = 5, 0
WEST, SOUTH, BEHIND = range(3)
PERSON, RIDER = 0, 1


def with_people(driven: Tracks) -> Recording:
    """A pedestrian to the north at x = -15 m, on the lane from 2.1 to 3.5 s, and a cyclist."""
    time = np.arange(FRAMES) * 0.1
    columns = {name: [getattr(driven, name)] for name in ("x", "y", "heading", "vx", "vy")}
    for x, y, speed in ((-15.0, -4.2, 1.5), (0.0, -30.0, 3.0)):
        columns["x"].append(np.full(FRAMES, x))
        columns["y"].append(y + speed * time)
        columns["heading"].append(np.full(FRAMES, np.pi / 2))
        columns["vx"].append(np.zeros(FRAMES))
        columns["vy"].append(np.full(FRAMES, speed))
    every = Tracks(
        track=np.repeat(np.arange(5, dtype=np.int32), FRAMES),
        frame=np.tile(np.arange(FRAMES, dtype=np.int32), 5),
        **{name: np.concatenate(parts) for name, parts in columns.items()},
        identity=np.arange(11, 16),
        road_user=np.array([0, 0, 0, RoadUser.PEDESTRIAN, RoadUser.BICYCLE], np.int8),
        length=np.append(driven.length, [0.5, 1.8]),
        width=np.append(driven.width, [0.6, 0.75]),
        dt=0.1,
        recording=driven.recording,
        source=driven.source,
    )
    return Recording(every, crossing_road())


@pytest.fixture(scope="module")
def peopled():
    return build([with_people(tracks())], WorldConfig())


def drive(world: RecordedWorld, ego: int, action: int, seeds=range(20)):
    """Decisions of episodes from the ego's first state to the end."""
    world = dataclasses.replace(world, road=world.road._replace(egos=np.array([ego])))
    batch, begun = world.batch(1), int(world.road.state_step[ego])
    for seed in seeds:
        batch.reset([seed])
        if batch.buffers.episodes["begun"][0] != begun:
            continue
        while True:
            decisions = batch.step(np.array([action]), auto_reset=False)
            yield decisions
            if decisions.ending[0] != Ending.NONE:
                break
        return
    raise AssertionError("no episode begins with the recording")


def test_people_are_where_they_were_recorded(peopled):
    road = peopled.world.road
    assert road.person_class.tolist() == [RoadUser.PEDESTRIAN, RoadUser.BICYCLE]
    assert road.person_first.tolist() == [0, 2]
    assert road.person_state_first.tolist() == [0, FRAMES, 2 * FRAMES]
    assert road.person_state[30] == pytest.approx([-15.0, 0.3, np.pi / 2, 1.5])
    assert road.person_size.tolist() == [[0.5, 0.6], [1.8, 0.75]]


def test_who_drives_on_hits_the_pedestrian(peopled):
    *_, decisions = drive(peopled.world, WEST, GO)
    assert decisions.ending[0] == Ending.COLLISION
    assert decisions.contact[0] == Contact.EGO_STRUCK
    hits = {name: value[0] for name, value in decisions.signals.items() if name.endswith("_hit")}
    assert hits == {"pedestrian_hit": 1.0, "bicycle_hit": 0.0, "others_hit": 0.0}


def test_a_calibrated_driver_brakes_for_the_pedestrian_and_for_the_cyclist(peopled):
    slowest = {}
    for ego in (WEST, SOUTH):
        steps = list(drive(peopled.world, ego, AS_DRIVER))
        assert all(not decisions.signals[name].any() for decisions in steps
                   for name in decisions.signals if name.endswith("_hit"))  # fmt: skip
        assert steps[-1].ending[0] != Ending.COLLISION
        slowest[ego] = min(float(decisions.speed[0]) for decisions in steps)
    alone = build([Recording(tracks(), crossing_road())], WorldConfig()).world
    free = min(float(decisions.speed[0]) for decisions in drive(alone, WEST, AS_DRIVER))
    assert slowest[WEST] < 4.0 < 6.0 < free
    assert contacts(peopled, 0, 3) | {"deepest_contact": 0} == {
        "vehicles": 9, "pairs_in_contact": 0, "deepest_contact": 0, "people": 6, "hit_a_person": 0,
    }  # fmt: skip


def test_a_person_who_walks_into_a_standing_ego_struck_it(peopled):
    # The ego stands from 2 s on, the pedestrian reaches its side at 5 s.
    road = peopled.world.road
    state = road.person_state.copy()
    state[:FRAMES, 0] = -32.0
    state[:FRAMES, 1] = -12.0 + 0.2 * np.arange(FRAMES)
    world = dataclasses.replace(peopled.world, road=road._replace(person_state=state))
    *_, decisions = drive(world, WEST, WAIT)
    assert decisions.contact[0] == Contact.EGO_WAS_STRUCK and decisions.signals["pedestrian_hit"][0]


def test_others_who_hit_somebody_are_counted(peopled):
    road = peopled.world.road
    # From the side at 20 m/s, quicker than a driver brakes; the ego from the south is elsewhere.
    state = road.person_state.copy()
    state[:FRAMES] = [-60.0, 0.0, 0.0, 20.0]
    state[:FRAMES, 0] += 2.0 * np.arange(FRAMES)
    world = dataclasses.replace(peopled.world, road=road._replace(person_state=state))
    hits = [decisions.signals["others_hit"][0] for decisions in drive(world, BEHIND, WAIT)]
    assert sum(hits) == 1.0
    assert contacts(peopled._replace(world=world), 0)["hit_a_person"] == 1


def test_the_ego_observes_people(peopled):
    batch = peopled.world.batch(1)
    for seed in range(50):
        batch.reset([seed])
        if batch.egos[0] == WEST:
            break
    rows = batch.observation.reshape(-1, 7)
    step = int(batch.buffers.episodes["sub_steps"][0])
    along = batch.buffers.vehicles["along"][0, WEST]
    state = peopled.world.road.person_state[step]
    origin = peopled.world.road.origin[WEST]
    at = -40.0 + along - peopled.world.road.state[0, 0]
    place = [-state[1] * -1, -(along + state[0] - at - origin)]
    visible = rows[np.abs(rows[:, 4]) + np.abs(rows[:, 3]) > 0]
    assert any(
        row[1:3] * 100 == pytest.approx([-place[0], place[1]], abs=0.1)
        and np.hypot(*row[3:5]) * 20 == pytest.approx(1.5, abs=1e-5)
        for row in visible
    )


def test_a_vehicle_that_stands_for_a_pedestrian_closes_no_line():
    driven = tracks(speeds={"west": 8.0, "south": 2.0, "behind": 2.0})
    x, vx = driven.x.copy(), driven.vx.copy()
    vx[20:FRAMES] = 0.0  # at x = -24 m
    x[:FRAMES] = -40.0 + np.cumsum(vx[:FRAMES]) * 0.1
    stands = dataclasses.replace(driven, x=x, vx=vx)
    alone = Recording(stands, crossing_road())
    closures = [
        build([recording], WorldConfig()).world.provenance["closures"]
        for recording in (alone, with_people(stands))
    ]
    assert closures == [1, 0]


def test_a_world_with_people_is_a_file_and_one_without_has_no_columns_of_them(
    peopled, made, tmp_path
):
    for number, (world, has) in enumerate([(peopled.world, True), (made.world, False)]):
        path = tmp_path / f"{number}.safetensors"
        world.save(path)
        assert (b"person_state" in path.read_bytes()) == has
        back = RecordedWorld.load(path).road
        for name, column in world.road._asdict().items():
            assert np.array_equal(getattr(back, name), column), name
            assert getattr(back, name).dtype == column.dtype


@pytest.mark.parametrize(
    ("name", "value", "line"),
    [
        ("person_first", np.array([0, 3]), "places in person_first"),
        ("person_state_first", np.array([0, 0, 120]), "without a state"),
        ("person_class", np.array([5, 0]), "people of another class"),
        ("person_step", np.array([0]), "people without a size or a beginning"),
        ("person_size", np.zeros((2, 2)), "without a size"),
        ("person_step", np.array([0, -1]), "a state before the recording"),
    ],
)
def test_a_file_whose_people_do_not_fit_is_refused(peopled, tmp_path, name, value, line):
    path = resealed(peopled.world, tmp_path / "bad.safetensors", **{name: value})
    with pytest.raises(UserError, match=line):
        RecordedWorld.load(path)


def test_effects_are_measured_where_the_ego_hits_somebody(peopled):
    world = dataclasses.replace(peopled.world, effects=EffectOptions())
    *_, decisions = drive(world, WEST, GO)
    assert decisions.ending[0] == Ending.COLLISION and np.isfinite(decisions.rewards.social).all()


def test_commands_count_people_by_class(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        f"def go(observation):\n    return 0 * observation[:, 0].astype(int) + {GO}\n"
    )
    path, world = tmp_path / "a.safetensors", tmp_path / "world.safetensors"
    files.save(path, with_people(tracks()))
    assert main(["data", "world", str(path), "--out", str(world), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    used = {row["road_user"]: row["used"] for row in summary["road_users"]}
    assert used == {"bicycle": 1, "car": 3, "pedestrian": 1}
    assert (summary["contacts"]["people"], summary["contacts"]["hit_a_person"]) == (10, 0)
    words = ["evaluate", "python:mine.py:go", "--allow-code", "--world", str(world)]
    words += ["--episodes", "30", "--json"]
    assert main(words) == 0
    row = json.loads(capsys.readouterr().out)
    assert 0 < row["pedestrian_hit"] < 1 and {"bicycle_hit", "others_hit"} <= row.keys()
    env = gymnasium.make(RECORDED_JUNCTION, file=world, render_mode="rgb_array")
    env.reset(seed=0)
    assert env.render().std() > 0


def test_a_shield_brakes_for_the_pedestrian(peopled, world):
    """The ego that goes on hits the pedestrian; with a shield of 3 s it brakes, and hits less."""
    road = peopled.world.road._replace(egos=np.array([WEST]))
    west = dataclasses.replace(peopled.world, road=road)
    hits = []
    shares = []
    for seconds in (1e-6, 3.0):  # the first brakes only in contact
        batch = west.batch(40)
        policy = shielded(west.driver("go"), batch, seconds)
        count = 0.0
        for step in play(batch, policy, np.arange(40)):
            count += step.made.signals["pedestrian_hit"][step.running].sum()
            np.testing.assert_array_equal(step.action, np.where(policy.noted, WAIT, GO))
        hits.append(count)
        shares.append(policy.share)
    assert hits[1] < hits[0]
    assert shares[0] < shares[1] < 1.0
    with pytest.raises(UserError, match="no one walks here"):
        shielded(world.driver("go"), world.batch(1), 2.0)
    with pytest.raises(UserError, match="positive"):
        shielded(west.driver("go"), batch, -1.0)


def test_the_commands_take_a_shield_in_a_file(peopled, tmp_path, capsys):
    path = tmp_path / "peopled.safetensors"
    peopled.world.save(path)
    delays = []
    for seconds in ("0", "3"):
        words = [str(path), "--episodes", "6", "--shield", seconds, "--json"]
        assert main(["evaluate", "go", "--world", *words]) == 0
        delays.append(json.loads(capsys.readouterr().out)["r_env"])
        assert main(["effects", *words, "--policy", "go"]) == 0
        delays.append(json.loads(capsys.readouterr().out)["drivers"][0]["r_env"])
    assert delays[0] == pytest.approx(delays[1])
    assert delays[2] == pytest.approx(delays[3])
    assert delays[0] != delays[2]
