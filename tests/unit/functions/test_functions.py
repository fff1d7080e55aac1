"""Each function gives the numbers of its command, of texts and of objects."""

import json
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file

import socialiq
from socialiq.cli.main import main
from socialiq.cli.output import Result
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import packaged_results
from socialiq.to_json import rounded

UNTYPED: Any = socialiq
TINY = {"updates": 20, "hidden": [8], "batch_size": 8}
OPTIONS = ["--updates", "20", "--hidden", "8", "--set", "batch_size=8"]


@pytest.fixture(autouse=True)
def as_a_user(as_a_user_runs_it, monkeypatch, tmp_path):
    """The tests' own checker of types would refuse wrong ones before the library does."""
    monkeypatch.chdir(tmp_path)


def network(features=6, actions=3, seed=0):
    draw = np.random.default_rng(seed).normal
    weight = draw(size=(actions, features)).astype(np.float32)
    return QPolicy((weight,), (draw(size=actions).astype(np.float32),), "relu", 1.0)


def command(capsys, *words, status=0):
    """Numbers that a command prints."""
    capsys.readouterr()
    assert main([*words, "--json"]) == status
    return json.loads(capsys.readouterr().out)


def numbers(result):
    return json.loads(json.dumps(rounded(result)))


@pytest.mark.parametrize("angle", [0, 30.0])
@pytest.mark.parametrize("stationary", [False, True])
def test_solve(angle, stationary, capsys):
    words = ["solve", "crossing5", "--angle", str(angle), *["--stationary"] * stationary]
    result = socialiq.solve("crossing5", angle, stationary=stationary)
    assert numbers(result) == command(capsys, *words)
    assert numbers(socialiq.solve(socialiq.world("crossing5"), angle, stationary=stationary)) == (
        numbers(result)
    )


def test_solve_at_several_angles():
    several = socialiq.solve("crossing5", angle=[0, 45])
    assert several["optima"] == [dict(socialiq.solve("crossing5", angle)) for angle in (0, 45)]
    assert "crossing5" in repr(several)


@pytest.mark.parametrize("form", ["text", "object"])
def test_collect(form, capsys):
    words = ["collect", "crossing7", "--set", "spawn_probability=0.5", "--episodes", "3"]
    printed = command(capsys, *words, "--seed", "2", "--clock", "--out", "command.safetensors")
    world = "crossing7,spawn_probability=0.5"
    world = world if form == "text" else socialiq.world(world)
    data = socialiq.collect(world, episodes=3, seed=2, clock=True, out="function.safetensors")
    same = socialiq.load("command.safetensors")
    assert all(np.array_equal(a, same.arrays()[name]) for name, a in data.arrays().items())
    assert {row["mode"]: row["episodes"] for row in printed["modes"]} == {
        mode: episodes for mode, (episodes, _) in data.counts().items()
    }
    assert socialiq.load("function.safetensors").n_episodes == data.n_episodes
    assert repr(data) == f"Demonstrations({data.summary()})"


def test_collect_of_drivers_as_texts_and_as_objects(capsys):
    network(70, 3).save("mine.safetensors")
    drivers = ["--driver", "fast=go", "--driver", "own=mine.safetensors"]
    words = ["collect", "intersection", *drivers, "--episodes", "2", "--out", "c.safetensors"]
    command(capsys, *words)
    same = socialiq.load("c.safetensors").arrays()
    for own in ("mine.safetensors", network(70, 3)):
        data = socialiq.collect("intersection", {"fast": "go", "own": own}, episodes=2)
        assert data.mode_names == ("fast", "own")
        assert all(np.array_equal(column, same[name]) for name, column in data.arrays().items())


@pytest.mark.parametrize(
    ("world", "features", "options"),
    [
        ("crossing7", 6, {}),
        ("crossing7", 6, {"episodes": 20}),
        ("intersection", 70, {"episodes": 5}),
    ],
    ids=["exact", "sampled", "intersection"],
)
def test_evaluate(world, features, options, capsys):
    policy = network(features)
    policy.save("p.safetensors")
    words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    printed = command(capsys, "evaluate", "p.safetensors", "--world", world, "--seed", "3", *words)
    result = socialiq.evaluate("p.safetensors", world, seed=3, **options)
    assert numbers(result) == printed
    assert dict(socialiq.evaluate(policy, socialiq.world(world), seed=3, **options)) == dict(result)
    assert repr(result).splitlines()[1].split() == ["method", printed["method"].split()[0]] or (
        printed["method"] in repr(result)
    )


def test_evaluate_several_policies_at_several_angles(capsys):
    network().save("a.safetensors")
    network(seed=1).save("b.safetensors")
    printed = command(capsys, "evaluate", "a.safetensors", "b.safetensors", "--angle", "45")
    objects = [network(), network(seed=1)]
    of_objects = numbers(socialiq.evaluate(objects, angle=45))
    for row, named in zip(of_objects["policies"], printed["policies"], strict=True):
        assert row | {"policy": named["policy"]} == named
    assert of_objects["pooled"] == printed["pooled"]
    turned = socialiq.evaluate(["a.safetensors", "b.safetensors"], angle=[45, 90])
    names = [{"policy": row.pop("policy")} for row in turned["policies"]]
    assert names == [{"policy": "a.safetensors"}, {"policy": "b.safetensors"}] * 2
    for row, named in zip(numbers(turned["policies"][:2]), printed["policies"], strict=True):
        assert row | {"policy": named["policy"]} == named
    assert [row["target_angle"] for row in turned["policies"]] == [45.0, 45.0, 90.0, 90.0]


@pytest.mark.slow  # it fits networks and resamples for a minute
def test_evaluate_on_data(capsys):
    network().save("a.safetensors")
    data = socialiq.collect("crossing7", episodes=4, out="d.safetensors")
    printed = command(capsys, "evaluate", "a.safetensors", "--data", "d.safetensors")
    result = socialiq.evaluate("a.safetensors", data="d.safetensors")
    assert numbers(result) == printed
    of_objects = socialiq.evaluate(network(), data=data)
    assert of_objects["policies"][0]["angles"] == result["policies"][0]["angles"]


@pytest.mark.parametrize(
    ("world", "drivers", "options"),
    [("intersection", ["gap_3s", "idm"], {"episodes": 3}), ("crossing7", ["p.safetensors"], {})],
    ids=["road", "gridworld"],
)
def test_effects(world, drivers, options, capsys):
    network().save("p.safetensors")
    words = [word for name in drivers for word in ("--policy", name)]
    words += [word for name, value in options.items() for word in (f"--{name}", str(value))]
    printed = command(capsys, "effects", world, *words)
    assert numbers(socialiq.effects(world, drivers, **options)) == printed
    again = socialiq.effects(socialiq.world(world), drivers, **options)
    assert numbers(again) == printed
    assert drivers[0] in repr(again)


def test_effects_of_an_object():
    network().save("p.safetensors")
    rows = [socialiq.effects("crossing7", it)["drivers"][0] for it in ("p.safetensors", network())]
    assert [row.pop("policy") for row in rows] == ["p.safetensors", repr(network())]
    assert rows[0] == rows[1]


@pytest.mark.parametrize("data", ["file", "object"])
def test_train_a_run_for_each_angle_and_seed(data, capsys):
    mixed = socialiq.collect("crossing5", episodes=3, out="d.safetensors")
    words = ["train", "iq-learn", "d.safetensors", "--world", "crossing5", "--angle", "0", "90"]
    printed = command(capsys, *words, "--seed", "0", "1", *OPTIONS, "--out", "run")
    how = {"world": "crossing5", "angle": [0, 90], "seed": range(2), **TINY}
    policies = socialiq.train("iq-learn", "d.safetensors" if data == "file" else mixed, **how)
    without_file = [{k: v for k, v in row.items() if k != "file"} for row in printed["policies"]]
    assert numbers(policies["policies"]) == without_file
    assert len(policies.trained) == 4 and policies.failures == ()
    again = socialiq.load("run")
    for run, policy in enumerate(policies.trained):
        assert policy.weights[0].tobytes() == again.policy(run).weights[0].tobytes()
    assert "angle" in repr(policies)


def test_train_writes_the_folder_of_the_command(capsys):
    socialiq.collect("crossing5", episodes=3, out="d.safetensors")
    words = ["train", "behaviour-cloning", "d.safetensors", "--seed", "1", *OPTIONS]
    words += ["--set", "weighted=true"]
    printed = command(capsys, *words, "--out", "command")
    how = {"weighted": True, **TINY, "out": "function"}
    policies = socialiq.train("behaviour-cloning", "d.safetensors", seed=1, **how)
    assert numbers(policies["policies"]) == printed["policies"]
    names = {path.name for path in Path("command").iterdir()}
    assert names == {path.name for path in Path("function").iterdir()}
    for name in names - {"run.json"}:
        assert Path("command", name).read_bytes() == Path("function", name).read_bytes()


@pytest.mark.parametrize(
    ("learner", "preset"), [("dial", {"preset": "offline"}), ("offline-dial", {})]
)
def test_train_a_dial(learner, preset, capsys):
    data = socialiq.collect("crossing5", episodes=3, clock=True, out="d.safetensors")
    words = ["train", learner, "d.safetensors", "--world", "crossing5", "--out", "run"]
    words += [word for name, value in preset.items() for word in (f"--{name}", value)]
    printed = command(capsys, *words, "--updates", "20", "--hidden", "8")
    with warnings.catch_warnings():  # so short a training may leave a dial that stands
        warnings.simplefilter("ignore")
        how = {"updates": 20, "hidden": 8, **preset}
        trained = socialiq.train(learner, data, world=socialiq.world("crossing5"), **how)
    assert trained["dials"][0]["sha256"] == printed["dials"][0]["sha256"]
    assert trained.policy().low == 0.0


def test_a_dial_is_evaluated_at_angles_of_an_argument_and_of_its_text():
    dial = DialPolicy(network(8), 0.0, 90.0)
    dial.save("dial.safetensors")
    turned = socialiq.evaluate(dial, "crossing7", angle=[0, 90])["policies"]
    assert [row["target_angle"] for row in turned] == [0.0, 90.0]
    texts = ["dial.safetensors@0", "dial.safetensors@90"]
    named = socialiq.evaluate(texts, "crossing7")["policies"]
    for row, alone in zip(named, turned, strict=True):
        assert {name: row[name] for name in alone} == alone


def test_a_config_trains_as_before():
    data = socialiq.collect("crossing5", episodes=2)
    static = socialiq.StaticConfig(
        updates=2, hidden=(4,), batch_size=4, online=False, value_term="value_expert"
    )
    assert repr(socialiq.train(static, socialiq.Hyperparameters(), data)) == (
        "Trained(iq_learn: 1 runs of 2 updates, failures=())"
    )


@pytest.mark.parametrize("format", ["card", "bom", "torch", "hub"])
@pytest.mark.parametrize("form", ["text", "object"])
def test_export(format, form, capsys):
    network().save("p.safetensors")
    ending = {"card": ".md", "bom": ".json", "torch": ".safetensors", "hub": ""}[format]
    words = ["export", "p.safetensors", "--format", format, "--out", f"c{ending}"]
    printed = command(capsys, *words)
    policy = "p.safetensors" if form == "text" else network()
    result = socialiq.export(policy, f"f{ending}")
    assert result["format"] == printed["format"]
    if format == "torch":
        same = load_file("c.safetensors")
        tensors = load_file("f.safetensors")
        assert tensors.keys() == same.keys()
        assert all(np.array_equal(tensors[name], same[name]) for name in same)


@pytest.mark.slow  # it needs an extra, which `make test` lacks
def test_export_a_dial_as_onnx(capsys):
    dial = str(packaged_results() / "intersection-dial-clock/iterated.safetensors")
    words = ["export", dial, "--angle", "45", "--format", "onnx", "--out", "command.onnx"]
    command(capsys, *words)
    socialiq.export(f"{dial}@45", "text.onnx")
    socialiq.export(socialiq.load(dial), "object.onnx", angle=45)
    files = [Path(f"{name}.onnx").read_bytes() for name in ("command", "text", "object")]
    assert files[0] == files[1] == files[2]


def test_audit(capsys):
    network().save("p.safetensors")
    words = ["profile", "new", "--world", "crossing7", "--angle", "0", "--out", "profile.toml"]
    assert main([*words, "--date", "2026-01-31"]) == 0
    words = ["audit", "p.safetensors", "--profile", "profile.toml", "--episodes", "50"]
    capsys.readouterr()
    status = main([*words, "--seed", "7", "--out", "command", "--json"])
    printed = json.loads(capsys.readouterr().out)
    result = socialiq.audit("p.safetensors", "profile.toml", "function", episodes=50, seed=7)
    assert result["verdict"] == printed["verdict"] and status == printed["verdict"]["exit_code"]
    assert {path.name for path in Path("command").iterdir()} == {
        path.name for path in Path("function").iterdir()
    }
    profile = socialiq.load("profile.toml")
    assert (
        socialiq.audit("p.safetensors", profile, episodes=50, seed=7)["verdict"]
        == (printed["verdict"])
    )
    assert result["verdict"]["reason"] in repr(result)
    assert UNTYPED.audit.profile.reader.load(profile) is profile  # the package stays one


@pytest.mark.parametrize("name", ["gap_3s", "atlas:prosocial", "prosocial"])
def test_driver_of_a_road(name):
    driver = socialiq.driver(name, "intersection")
    batch = socialiq.world("intersection").batch(2)
    assert np.shape(driver.predict(batch.reset(0))[0]) == (2,)
    assert name.removeprefix("atlas:") in repr(driver)


def test_driver_of_an_object_and_of_an_environment():
    network().save("p.safetensors")
    seen = np.zeros(6, np.float32)
    world = socialiq.world("crossing7")
    drivers = [
        socialiq.driver(it, world) for it in ("p.safetensors", network(), Path("p.safetensors"))
    ]
    drivers.append(socialiq.driver(drivers[0], "crossing7"))
    assert len({int(driver.predict(seen)[0]) for driver in drivers}) == 1
    network(4, 2).save("pole.safetensors")
    pole = socialiq.driver("pole.safetensors", "CartPole-v1")
    assert pole.predict(np.zeros(4, np.float32))[0] in (0, 1)


def test_load_reads_what_was_written():
    network().save("p.safetensors")
    assert socialiq.load("p.safetensors").weights[0].tobytes() == network().weights[0].tobytes()
    assert repr(socialiq.load("p.safetensors")) == repr(network())
    Path("plain.csv").write_text("a,b\n")
    Path("folder").mkdir()
    for name, says in [
        ("missing.safetensors", "missing.safetensors"),
        ("plain.csv", "read it: socialiq data from-arrays"),
        ("policy.onnx", "socialiq.driver"),
        ("folder", "run.json"),
    ]:
        with pytest.raises(socialiq.UserError, match=says):
            socialiq.load(name)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: socialiq.world("crossing9"), "unknown world 'crossing9': choose one of"),
        (lambda: socialiq.world("merge,cyclists=0.1"), "merge has no cyclists"),
        (lambda: socialiq.driver("gap_9s", "intersection"), "unknown driver 'gap_9s'"),
        (lambda: socialiq.solve("intersection"), "the states of intersection can't be listed"),
        (lambda: socialiq.solve("crossing7", 400), "angle 400"),
        (lambda: socialiq.collect("crossing7", mixture="even"), "unknown mixture 'even'"),
        (lambda: socialiq.collect("crossing7", episode=3), "did you mean episodes?"),
        (lambda: UNTYPED.collect("crossing7", episodes="3"), "episodes is of the type str"),
        (lambda: socialiq.train("iqlearn"), "unknown learner 'iqlearn': choose one of iq-learn"),
        (lambda: socialiq.train("dial", world="crossing7", seed=-1), "seed must be at least 0"),
        (lambda: socialiq.train("dial", world="crossing7", updating=3), "no setting updating"),
        (lambda: socialiq.train("dial", world="crossing7"), "learns from demonstrations"),
        (lambda: socialiq.evaluate("p.safetensors", "intersection"), "add --episodes N"),
        (lambda: socialiq.evaluate("none.safetensors"), "none.safetensors"),
        (lambda: socialiq.evaluate([]), "policies is empty: give at least one value"),
        (lambda: socialiq.effects("intersection", []), "policy is empty: give at least one value"),
        (lambda: socialiq.solve("crossing5", []), "angle is empty: give at least one value"),
        (lambda: socialiq.export("nemo", "a.md"), "no policy 'nemo': name a file"),
        (lambda: socialiq.export("prosocial", "a.png"), "unknown ending '.png': choose one of"),
        (lambda: UNTYPED.audit(3, "profile.toml"), "policy is of the type int: pass str"),
        (lambda: socialiq.audit("p.safetensors", "no.toml"), "no such file: no.toml"),
    ],
)
def test_a_mistake_is_one_line(call, says):
    with pytest.raises(socialiq.UserError) as caught:
        call()
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_a_world_that_no_text_names_is_refused():
    world = socialiq.make("crossing7").with_clock()
    with pytest.raises(socialiq.UserError, match=r"make it by socialiq\.world"):
        socialiq.solve(world)


def test_functions_print_nothing(capsys):
    socialiq.effects("intersection", ["gap_3s"], episodes=2)
    data = socialiq.collect("crossing5", episodes=2)
    socialiq.train("behaviour-cloning", data, weighted=True, **TINY)
    assert capsys.readouterr() == ("", "")


def test_each_seed_of_an_evaluation_is_a_row_and_means_have_standard_errors(tmp_path):
    network().save("p.safetensors")
    how: Any = {"episodes": 20}
    result = socialiq.evaluate("p.safetensors", angle=[0, 90], seed=range(3), **how)
    single = [
        dict(socialiq.evaluate("p.safetensors", angle=angle, seed=seed, **how))
        for angle in (0, 90)
        for seed in range(3)
    ]
    assert [{name: row[name] for name in single[0]} for row in result["policies"]] == single
    assert [row["seed"] for row in result.table] == [0, 1, 2] * 2
    assert [dict(outcome) for outcome in result.outcomes] == single
    means = result.means()
    assert [row["target_angle"] for row in means] == [0.0, 90.0]
    values = [row["regret"] for row in single[3:]]
    assert means[1]["regret"] == pytest.approx(np.mean(values))
    assert means[1]["regret_error"] == pytest.approx(np.std(values, ddof=1) / 3**0.5)
    assert means[1]["seeds"] == 3 and not any(name.endswith("_low") for name in means[0])
    text = result.to_csv("table.csv")
    assert Path("table.csv").read_text() == text and len(text.splitlines()) == 7
    with pytest.raises(socialiq.UserError, match=r"table\.csv exists"):
        result.to_csv("table.csv")


def test_trained_policies_are_measured_with_their_angles_and_seeds():
    data = socialiq.collect("crossing5", episodes=3)
    how = {"world": "crossing5", "angle": [0, 90], "seed": [4, 5], **TINY}
    policies = socialiq.train("iq-learn", data, **how)
    assert [row["seeds"] for row in policies.means()] == [2, 2]
    result = socialiq.evaluate(policies, "crossing5", angle=45)
    pairs = [(row["trained_angle"], row["training_seed"]) for row in result.table]
    assert pairs == [(0.0, 4), (0.0, 5), (90.0, 4), (90.0, 5)]
    alone = socialiq.evaluate(policies.trained, "crossing5", angle=45)
    assert [row["regret"] for row in result.table] == [row["regret"] for row in alone["policies"]]
    means = result.means()
    assert [(row["trained_angle"], row["seeds"]) for row in means] == [(0.0, 2), (90.0, 2)]
    regrets = [row["regret"] for row in result.table]
    assert means[0]["regret"] == pytest.approx(np.mean(regrets[:2]))
    totals = [np.mean([row[name] for row in result.table[:2]]) for name in ("r_env", "r_social")]
    assert means[0]["angle"] == pytest.approx(np.degrees(np.arctan2(totals[1], totals[0])))
    assert "angle_error" not in means[0]
    caused = socialiq.effects("crossing5", policies)
    assert [(row["trained_angle"], row["seeds"]) for row in caused.means()] == [(0.0, 2), (90.0, 2)]
    files = socialiq.export(policies, "policy.md")["files"]
    assert [row["out"] for row in files] == [f"policy-policy{run}.md" for run in range(4)]


def test_several_worlds_of_solve_effects_and_collect():
    optima = socialiq.solve([socialiq.world("crossing5"), "crossing7"], [0, 45])["optima"]
    assert [(row["world"], row["angle"]) for row in optima] == [
        (world, angle) for world in ("crossing5", "crossing7") for angle in (0.0, 45.0)
    ]
    worlds = ["intersection", "merge"]
    result = socialiq.effects(worlds, ["wait", "idm"], episodes=2, seed=[0, 2], out="folder")
    alone = socialiq.effects("merge", ["wait", "idm"], episodes=2, seed=2)["drivers"]
    assert [{name: row[name] for name in alone[0]} for row in result.table[-2:]] == alone
    assert len(result.table) == 8 and len(result.means()) == 4
    assert Path("folder-world1-seed2", "effects.csv").exists()
    data = socialiq.collect("crossing5", episodes=2, seed=[1, 2], out="mixed.safetensors")
    again = socialiq.load("mixed-seed2.safetensors")
    assert isinstance(data, Result) and len(data.table) == 6
    assert all(
        np.array_equal(column, again.arrays()[name])
        for name, column in data.outcomes[1].arrays().items()
    )
    with pytest.raises(socialiq.UserError, match=r"mixed-seed2\.safetensors exists"):
        socialiq.collect("crossing5", episodes=2, seed=[0, 2], out="mixed.safetensors")
    assert not Path("mixed-seed0.safetensors").exists()  # refused before the first call works


def test_several_audits_are_rows():
    network().save("p.safetensors")
    network(seed=1).save("q.safetensors")
    words = ["profile", "new", "--world", "crossing7", "--angle", "0", "--out", "profile.toml"]
    assert main([*words, "--date", "2026-01-31"]) == 0
    policies = ["p.safetensors", "q.safetensors"]
    result = socialiq.audit(policies, "profile.toml", "out", episodes=20, seed=[7, 8])
    assert [row["policy"] for row in result["audits"]] == [
        policy for policy in policies for _ in range(2)
    ]
    report = json.loads(Path("out-policy1-seed8", "report.json").read_text())
    assert report["verdict"]["decision"] == result.table[3]["decision"]
    assert result.outcomes[3]["policy"]["means"]["arrival"] == result.table[3]["arrival"]


def test_what_a_command_complains_of_is_a_warning():
    flat = QPolicy((np.zeros((3, 70), np.float32),), (np.zeros(3, np.float32),), "relu", 1.0)
    with pytest.warns(UserWarning, match="observes fewer classes than are here"):
        socialiq.driver(flat, "intersection,people=0.1")


def test_functions_of_saved_policies_load_no_learner():
    names = (
        "world",
        "driver",
        "load",
        "collect",
        "export",
        "evaluate",
        "effects",
        "audit",
        "solve",
    )
    code = f"import sys, socialiq; [getattr(socialiq, name) for name in {names}]; "
    code += "socialiq.effects('intersection', 'gap_3s', episodes=2); print('jax' in sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout == "False\n"
