"""Worlds in SUMO: episodes that repeat, an ego that drives as in our core, and what it causes."""

import contextlib
import csv
import json
import math
import re
import runpy
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

pytest.importorskip("libsumo", reason="extra `sumo` is not installed")

from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.profile.profile import measured_in, world_of
from socialiq.audit.report.views import by_class
from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.evaluation.effects import sums_in
from socialiq.evaluation.shield import shielded
from socialiq.isolation import isolation_of
from socialiq.worlds.highway import observation as observation_columns
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.registry import make
from socialiq.worlds.sumo.gym import SumoEnv
from socialiq.worlds.sumo.isolated import IsolatedEpisode, episode_of
from socialiq.worlds.sumo.network import NETS
from socialiq.worlds.sumo.simulation import Body, Episode, gap_ahead
from socialiq.worlds.sumo.traffic import Scene, SumoOptions
from socialiq.worlds.world import ConstantPolicy

SLOWER, IDLE, FASTER = range(3)
EMPTY = {"vehicle_rate": 0.0, "bicycle_rate": 0.0, "pedestrian_rate": 0.0}


def episode(env, seed, actions):
    """Return the observations and rewards of an episode as bytes, and the last info."""
    observation, _ = env.reset(seed=seed)
    trace, info = [observation.tobytes()], {}
    for action in actions:
        observation, _, terminated, truncated, info = env.step(action)
        trace.append(observation.tobytes() + info["reward_pair"].tobytes())
        if terminated or truncated:
            break
    return trace, info


@pytest.mark.parametrize("name", ["socialiq/Sumo-v1", "socialiq/SumoRow-v1"])
def test_an_episode_is_determined_by_its_seed(name):
    env = gymnasium.make(name, disable_env_checker=True)
    actions = [FASTER, SLOWER, IDLE, FASTER, FASTER] * 4
    assert episode(env, 5, actions)[0] == episode(env, 5, actions)[0]
    assert episode(env, 5, actions)[0] != episode(env, 6, actions)[0]


def test_episodes_side_by_side_and_restored_ones_keep_every_bit():
    env, another = (gymnasium.make("socialiq/Sumo-v1").unwrapped for _ in range(2))
    plain, _ = episode(env, 2, [SLOWER] * 4 + [FASTER] * 4)
    env.reset(seed=2)
    another.reset(seed=7)
    mixed = []
    for number in range(8):
        observation, *_, info = env.step(FASTER if number > 3 else SLOWER)
        mixed.append(observation.tobytes() + info["reward_pair"].tobytes())
        another.step(IDLE)
        if number == 3:
            state = env.save()
    assert mixed == plain[1:]
    another.restore(state)
    observation, *_, info = another.step(FASTER)
    assert observation.tobytes() + info["reward_pair"].tobytes() == plain[5]


def test_alone_the_ego_drives_as_in_our_core_and_causes_nothing():
    env = gymnasium.make("socialiq/Sumo-v1", **EMPTY).unwrapped
    core = make("intersection", initial_vehicle_count=1, spawn_probability=0.0).batch(1)
    core.reset([3])
    core.buffers.vehicles["y"][0, core.buffers.episodes["controlled"][0, 0]] = 0.0
    observation, _ = env.reset(seed=3)
    assert observation.shape == (70,) and not observation[7:].any()
    assert observation[[0, 4, 6]].tolist() == [1.0, -0.5, -1.0]
    assert abs(observation[1] - 0.02) < 1e-6 and 0.3 < observation[2] < 0.7
    for action in (FASTER, SLOWER, SLOWER, FASTER, IDLE):
        speed = core.step(np.array([action])).speed[0]
        info = env.step(action)[-1]
        assert info["speed"] == pytest.approx(speed, abs=1e-9)
        assert info["reward_pair"][1] == 0.0
    assert episode(env, 3, [FASTER] * 20)[1]["ending"] == "arrival"


def test_who_waits_holds_up_those_behind_and_is_not_paid_for_pedestrians():
    env = gymnasium.make("socialiq/Sumo-v1", vehicle_rate=0.6, pedestrian_rate=0.0)
    behind = 0.0
    for seed in range(3):
        _, info = episode(env, seed, [SLOWER] * 20)
        lasting = env.unwrapped.episode
        entries = {
            name: lasting.without[name] - lasting.driven.get(name, 0.0) for name in lasting.without
        }
        behind += sum(entries.values())
        assert info["ending"] == "timeout" and info["signals"]["delay_pedestrian"] == 0.0
    assert behind > 50.0


def test_signals_add_up_to_what_others_lose(capsys):
    env = gymnasium.make("socialiq/Sumo-v1", pedestrian_rate=1.0)
    for seed in range(4):
        env.reset(seed=seed)
        lost, ended = 0.0, False
        while not ended:
            *_, terminated, truncated, info = env.step(FASTER)
            lost += info["signals"]["delay"]
            ended = terminated or truncated
        lasting = env.unwrapped.episode
        assert lost == pytest.approx(sum(lasting.without.values()) - sum(lasting.driven.values()))
    assert capsys.readouterr().out == ""  # standard output belongs to --json


def test_commands_take_worlds_in_sumo(tmp_path, capsys):
    assert main(["world", "sumo", "row", "--json"]) == 0
    described = json.loads(capsys.readouterr().out)
    assert len(described["ways"]) == 56 and described["entered"]["pedestrian"] > 0
    effects = ["effects", "sumo", "--policy", "go", "--policy", "wait", "--episodes", "2"]
    assert main([*effects, "--out", str(tmp_path / "effects"), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["drivers"]
    assert {"delay", "delay_pedestrian", "braking", "arrival"} <= rows[0].keys()
    dial = "results/caused-effects/dial.safetensors"
    assert main(["evaluate", dial, "--world", "sumo", "--angle", "45", "--episodes", "2"]) == 0
    assert "observe vehicles and bicycles, and no pedestrians" in capsys.readouterr().err
    assert main(["evaluate", "wait", "--world", "sumo", "--episodes", "2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["arrival"] == 0.0


def test_a_declaration_names_the_network_and_the_demand(tmp_path, capsys):
    net, demand = tmp_path / "mine.net.xml", tmp_path / "mine.rou.xml"
    net.write_text(NETS["crossing"].read_text())
    flow = '<flow id="a" begin="0" end="300" vehsPerHour="{}" from="WC" to="CE"/>'
    demand.write_text(f"<routes>{flow.format(600)}</routes>")
    assert main(["world", "sumo", str(net), "--demand", str(demand), "--json"]) == 0
    described = json.loads(capsys.readouterr().out)
    assert described["demand"] == {"vehicle": 50, "bicycle": 0, "pedestrian": 0}
    assert 5 < described["entered"]["vehicle"] < 10
    for command in (["evaluate", "go", "--world", "sumo"], ["effects", "sumo", "--policy", "go"]):
        words = [*command, "--episodes", "3", "--json"]
        assert main(words) == 0
        drawn = json.loads(capsys.readouterr().out)
        assert main([*words, "--demand", str(demand)]) == 0
        demanded = json.loads(capsys.readouterr().out)
        rows = [result.get("drivers", [result])[0] for result in (drawn, demanded)]
        assert rows[0] != rows[1]
        assert main([*words, "--demand", str(net)]) == 2
        assert "has no <routes> but <net>" in capsys.readouterr().err
    declare = ["profile", "new", "--world", str(net), "--angle", "45", "--set", f"demand={demand}"]
    assert main([*declare, "--out", str(tmp_path / "p.toml")]) == 0
    assert main(["profile", "check", str(tmp_path / "p.toml")]) == 0
    for file, text in ((demand, demand.read_text()), (net, net.read_text())):
        file.write_text(text.replace("600", "300").replace("</net>", "</net>\n"))
        assert main(["profile", "check", str(tmp_path / "p.toml")]) == 2
        assert "is of another world" in capsys.readouterr().err
        file.write_text(text)


def test_an_ego_enters_at_its_time_though_others_wait_for_its_edge():
    env = gymnasium.make("socialiq/Sumo-v1")
    env.reset(seed=197)
    assert env.unwrapped.episode.without


def test_audits_measure_effects_by_class_in_the_episodes_that_effects_measures():
    world, seeds = world_of("sumo", {}), np.arange(40, 44)
    measured = list(measured_in("sumo"))
    course = Course(world, seeds, measured=measured)
    waiting = Reference("wait", ConstantPolicy(0))
    beside = course.drive(waiting).episodes
    sums = sums_in(gymnasium.make("socialiq/Sumo-v1"), policy("wait"), seeds)
    columns = {
        "delay": "delay_vehicle",
        "waiting": "waiting_pedestrian",
        "pedestrian_hit": "collision_pedestrian",
        "cyclist_delay": "waiting_bicycle",
        "cyclist_hit": "collision_bicycle",
        "braking": "braking_vehicle",
    }
    assert columns.keys() == set(measured) < beside.keys()
    for name, column in columns.items():
        assert beside[name].tolist() == sums[column].tolist()
    assert beside["delay"].mean() > 20.0 and np.any(beside["waiting"])


@pytest.mark.slow
def test_a_declaration_bounds_effects_by_class(tmp_path, capsys, monkeypatch):
    dial = str(Path("results/caused-effects/dial.safetensors").absolute())
    monkeypatch.chdir(tmp_path)
    declare = ["profile", "new", "--world", "socialiq/Sumo-v1", "--angle", "90"]
    bounds = ["--max-delay", "300", "--max-waiting", "30", "--min-waiting", "10"]
    assert main([*declare, "--max-gap-below-1-s", "0.2"]) == 2
    assert "measures only delay, braking, waiting, " in capsys.readouterr().err
    assert main([*declare, "--set", "clock=true", *bounds]) == 0
    command = ["audit", dial, "--profile", "profile.toml", "--episodes", "20", "--out", "audit"]
    assert main(command) == 2
    assert "name at least one with --reference" in capsys.readouterr().err
    assert not Path("audit-log").exists()
    assert main(["turn", dial, "--angle", "0", "--out", "egoist.safetensors"]) == 0
    assert main([*command, "--reference", "egoist.safetensors"]) in (1, 3)
    lines = by_class(json.loads(Path("audit/report.json").read_text()))
    assert [line["class"] for line in lines] == [
        "vehicles",
        "pedestrians",
        "pedestrians",
        "cyclists",
    ]
    assert lines[1]["asked for"] == "at most 30 s"
    assert lines[3]["name"] == "no bound is declared"
    assert main(["audit", "verify", "audit"]) == 0


def test_the_referee_repeats_its_results():
    compare = runpy.run_path("benchmarks/sumo_referee.py")["compare"]
    with Path("results/sumo-referee/states.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if abs(float(row["sumo"])) > 2][::40]
    assert len(rows) > 5
    for row in rows:
        repeated = compare(int(row["seed"]), row["driver"], row["model"])
        assert {name: str(value) for name, value in repeated.items()} == row


def test_a_parameter_of_a_demand_writes_no_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    victim = tmp_path / "victim.txt"
    victim.write_text("precious")
    (tmp_path / "spy.rou.xml").write_text(
        '<routes><vType id="spy" vClass="passenger"><param key="has.ssm.device" value="true"/>'
        f'<param key="device.ssm.file" value="{victim}"/></vType>'
        '<flow id="a" type="spy" begin="0" end="60" period="2" from="WC" to="CE"/></routes>'
    )
    assert main(["world", "sumo", "crossing", "--demand", "spy.rou.xml"]) == 0
    assert victim.read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["spy.rou.xml", "victim.txt"]
    assert (
        "spy.rou.xml: SUMO does not get <param has.ssm.device> (1), <param device.s"
        in capsys.readouterr().out
    )


@pytest.mark.skipif(not isolation_of("auto").works, reason="no sandbox here")
def test_a_network_of_a_user_is_played_in_a_sandbox_with_the_same_bits(tmp_path):
    copy = tmp_path / "copy.net.xml"
    copy.write_text(NETS["crossing"].read_text())
    episodes = list[list[Any]]()
    for net in ("crossing", str(copy)):
        env = gymnasium.make("socialiq/Sumo-v1", net=net)
        first, _ = env.reset(seed=5)
        steps = [env.step(action) for action in (FASTER, IDLE, SLOWER)]
        env.reset(seed=6)  # the sandbox now holds another episode
        state = env.unwrapped.save()
        env.unwrapped.restore(state)
        steps += [env.step(FASTER)]
        episodes.append([first.tolist(), [(step[0].tolist(), *step[1:]) for step in steps]])
    np.testing.assert_equal(episodes[0], episodes[1])
    assert isinstance(env.unwrapped.episode, IsolatedEpisode)


@pytest.mark.skipif(not isolation_of("auto").works, reason="no sandbox here")
def test_sumo_in_the_sandbox_writes_no_file_even_if_it_is_told_to(tmp_path):
    victim = tmp_path / "victim.txt"
    victim.write_text("precious")
    demand = tmp_path / "spy.rou.xml"
    demand.write_text(
        '<routes><vType id="spy" vClass="passenger"/>'
        '<flow id="a" type="spy" begin="0" end="60" period="2" from="WC" to="CE"/></routes>'
    )
    scene = Scene(SumoOptions(demand=str(demand)))
    hostile = (
        '<vType id="of.spy" vClass="passenger"><param key="has.ssm.device" value="true"/>'
        f'<param key="device.ssm.file" value="{victim}"/></vType>'
    )
    scene.user_demand = scene.user_demand._replace(types=[hostile])
    with contextlib.suppress(UserError):
        episode_of(scene, 0).step(FASTER)
    assert victim.read_text() == "precious"
    Episode(scene, 0).step(FASTER)
    assert victim.read_text() != "precious"  # without the sandbox the attack works


def test_a_shield_brakes_for_people_in_sumo():
    """The ego goes slower where a pedestrian or a cyclist is in its way, or gets into it."""
    env = gymnasium.make("socialiq/Sumo-v1", pedestrian_rate=1.0).unwrapped
    policy = shielded(ConstantPolicy(FASTER), env, 3.0)
    braked = []
    for seed in range(6):
        env.reset(seed=seed)
        over = False
        while not over:
            action, _ = policy.predict(env._observation())
            near = env.near(3.0)[0]
            assert action == (SLOWER if near else FASTER)
            braked.append(near)
            _, _, terminated, truncated, _ = env.step(int(action))
            over = terminated or truncated
    assert 0 < sum(braked) < len(braked)
    empty = gymnasium.make("socialiq/Sumo-v1", **EMPTY).unwrapped
    with pytest.raises(UserError, match="no one walks here"):
        shielded(ConstantPolicy(FASTER), empty, 3.0)


def test_a_person_counts_in_the_way_or_on_the_way_into_it():
    def body(x, y, along_x, along_y, speed):
        return Body(x, y, 0.0, speed, along_x, along_y, "pedestrian")

    ego = body(0.0, 0.0, 1.0, 0.0, 5.0)
    gaps = [
        gap_ahead(ego, body(*place), 2.0)
        for place in (
            (12.5, 0.5, 0.0, 1.0, 0.0),  # stands in the way
            (12.5, 3.5, 0.0, -1.0, 1.5),  # comes within 4/3 s
            (12.5, 5.5, 0.0, -1.0, 1.5),  # comes within 8/3 s
            (12.5, 3.5, 0.0, 1.0, 1.5),  # goes away
            (-5.0, 0.0, 1.0, 0.0, 1.5),  # is behind
        )
    ]
    assert gaps == [10.0, 10.0, math.inf, math.inf, math.inf]


def test_the_commands_take_a_shield_and_a_fallback_in_sumo(tmp_path, capsys):
    scored = str(tmp_path / "scored.safetensors")
    assert main(["unlikeness", "prosocial", "--episodes", "20", "--out", scored]) == 0
    capsys.readouterr()
    more = ["--episodes", "3", "--json"]
    rewards = []
    for words in ([], ["--shield", "4"], ["--fallback", "wait=0.5"]):
        assert main(["evaluate", scored, "--world", "sumo", *more, *words]) == 0
        row = json.loads(capsys.readouterr().out)
        assert main(["effects", "sumo", "--policy", scored, *more, *words]) == 0
        effects = json.loads(capsys.readouterr().out)["drivers"][0]
        assert effects["r_env"] == pytest.approx(row["r_env"])
        assert effects.get("fallback") == row.get("fallback")
        rewards.append(row["r_env"])
    assert 0.0 < row["fallback"] < 1.0
    assert len({*rewards}) == 3


@pytest.mark.parametrize("net", ["crossing", "row"])
def test_the_observation_along_the_route_leads_to_the_arrival(net):
    """`to_arrival` falls by the metres driven and passes 0 in the decision of the arrival."""
    env = SumoEnv(net, observation="route")
    columns = observation_columns.names_of(observation_columns.EGO)
    at = columns.index("to_arrival_60"), columns.index("speed"), columns.index("beside")
    observation, _ = env.reset(seed=3)
    left = observation[at[0]]
    for _ in range(20):
        assert env.observation_space.contains(observation)
        assert abs(4 * observation[at[2]]) < 2.0  # inside of the bend
        observation, _, terminated, truncated, info = env.step(2)
        after = observation[at[0]]
        if left < 1:
            assert 60 * (left - after) == pytest.approx(10 * observation[at[1]], abs=1.5)
        left = after
        if terminated or truncated:
            break
        assert left > 0
    assert info["ending"] == "arrival" and left <= 0


def test_pedestrians_and_bicycles_are_observed_along_the_route():
    env = SumoEnv("crossing", observation="route", pedestrian_rate=1.0, bicycle_rate=0.5)
    names = observation_columns.names_of(observation_columns.USER)
    ego, user = observation_columns.LAYOUT
    classes = [names.index(name) for name in ("vehicle", "on_foot", "rides")]
    counts = np.zeros(3)
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        counts += observation[ego:].reshape(-1, user)[:, classes].sum(axis=0)
    assert (counts > 0).all()
    assert env.action_space.n == 5
    observation = env.step(3)[0]  # a change of lanes keeps the target speed
    assert env.observation_space.contains(observation)


def mirrored(text):
    """Return a network that is 222 m wide as its mirror image, with left-hand traffic."""

    def points(match):
        pairs = (point.split(",", 1) for point in match[2].split())
        return match[1] + " ".join(f"{222 - float(x):.2f},{rest}" for x, rest in pairs)

    text = re.sub(r'(shape=")([^"]*)', points, text)
    text = re.sub(
        r'(<junction [^>]*? x=")([^"]*)', lambda m: f"{m[1]}{222 - float(m[2]):.2f}", text
    )
    return text.replace("<net ", '<net lefthand="true" ')


@pytest.mark.parametrize("schema", ["rows", "route"])
def test_in_left_hand_traffic_policies_observe_the_mirror_image(schema, tmp_path):
    """The same draws on the mirrored crossing give the same numbers, also those to the side."""
    net = tmp_path / "mirrored.net.xml"
    net.write_text(mirrored(NETS["crossing"].read_text()))
    right, left = (
        SumoEnv(name, observation=schema, pedestrian_rate=0.0) for name in ("crossing", str(net))
    )
    assert left.scene.way == right.scene.way == ["SC", "CW"]
    turned = []
    for seed in (0, 2):
        rng = np.random.default_rng(seed)
        observed = [env.reset(seed=seed)[0] for env in (right, left)]
        ended = False
        while not ended:
            np.testing.assert_allclose(observed[1], observed[0], atol=1e-6)
            action = int(rng.integers(3))
            (first, _, *ends, info), (second, _, *others, reflected) = (
                env.step(action) for env in (right, left)
            )
            observed = [first, second]
            turned.append(np.abs(right.episode.bodies[0].along_x))
            np.testing.assert_allclose(reflected["reward_pair"], info["reward_pair"], atol=1e-6)
            assert others == ends
            ended = any(ends)
    assert max(turned) > 0.9


def test_the_side_of_the_traffic_is_told(tmp_path, capsys):
    net = tmp_path / "mirrored.net.xml"
    net.write_text(mirrored(NETS["crossing"].read_text()))
    assert main(["world", "sumo", str(net)]) == 0
    assert "left: policies observe the mirror image" in capsys.readouterr().out
    for name, is_left in ((str(net), True), ("crossing", False)):
        assert main(["world", "sumo", name, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["left_hand"] is is_left
