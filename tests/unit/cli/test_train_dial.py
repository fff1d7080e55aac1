"""`train dial` with presets whose programs take long to compile."""

import json

import jax
import pytest

from socialiq.cli.main import main
from socialiq.learners.dial.config import QUICK, RUNS
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy


@pytest.fixture(scope="module")
def clocked(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "clocked.safetensors"
    arguments = ["collect", "crossing7", "--clock", "--episodes", "3", "--out", str(path)]
    assert main(arguments) == 0
    return path


@pytest.mark.slow
def test_a_dial_can_be_trained_without_demonstrations(tmp_path):
    out = tmp_path / "run"
    arguments = [
        "train",
        "dial",
        "--world",
        "crossing5",
        "--preset",
        "online-alone",
        "--out",
        str(out),
    ]
    assert main([*arguments, "--updates", "5"]) == 0
    assert (out / "dial_0.safetensors").exists()


@pytest.mark.slow
def test_the_quick_preset_is_a_smaller_network_on_the_same_rows(clocked, tmp_path):
    out = tmp_path / "run"
    arguments = ["train", "dial", str(clocked), "--world", "crossing7", "--out", str(out)]
    assert main([*arguments, "--preset", "online-quick", "--updates", "5"]) == 0
    structure = json.loads((out / "run.json").read_text())["structure"]
    assert structure["hidden"] == list(QUICK.structure.hidden)
    assert structure["expert_batch"] + structure["replay_batch"] == 128
    assert structure["redraw_times"] == RUNS["online"].structure.redraw_times


@pytest.mark.slow
def test_a_strength_is_found_for_a_budget(clocked, tmp_path):
    """Far from its optimum after so few updates: the multiplier only rises, and says so."""
    out = tmp_path / "run"
    arguments = ["train", "dial", str(clocked), "--world", "crossing7", "--preset", "offline"]
    arguments += ["--angle", "45", "--budget", "0.01", "--updates", "600", "--out", str(out)]
    assert main(arguments) == 0
    record = json.loads((out / "run.json").read_text())
    assert (record["structure"]["low"], record["structure"]["high"]) == (45, 45)
    assert [look["updates"] for look in record["budget_path"]] == [250, 500]
    (found,) = record["dials"]
    assert found["multiplier"] == pytest.approx(record["budget_path"][-1]["multiplier"][0])
    first, last = (look["regret"][0] for look in record["budget_path"])
    assert min(first, last) > 0.02 and found["multiplier"] > 1.5
    assert found["regret"] == pytest.approx(last)


@pytest.mark.slow
def test_a_dial_of_the_intersection_sees_the_time_and_is_driven(tmp_path, capsys):
    """Trained, evaluated, calibrated, turned and driven as any policy, in short."""
    data, out = tmp_path / "data.safetensors", tmp_path / "run"
    drivers = [
        word for name in ("wait", "go") for word in ("--driver", policy_file(tmp_path, name))
    ]
    collect = ["collect", "socialiq/Intersection-v1", *drivers, "--episodes", "2"]
    assert main([*collect, "--out", str(data)]) == 0
    arguments = ["train", "dial", str(data), "--world", "intersection", "--out", str(out)]
    small = [
        "--updates",
        "2",
        "--hidden",
        "8",
        "--set",
        "expert_batch=4",
        "--set",
        "replay_batch=4",
    ]
    assert main([*arguments, *small, "--set", "replay_capacity=3000"]) == 0
    record = json.loads((out / "run.json").read_text())
    assert record["preset"] == "intersection" and record["structure"]["redraw_times"] == 20
    dial, told = out / "dial_0.safetensors", tmp_path / "told.safetensors"
    command = ["dial", "intersection", "--policy", str(dial), "--every", "45", "--episodes", "4"]
    assert main([*command, "--calibrated", str(told)]) == 0
    turned = str(tmp_path / "turned.safetensors")
    assert main(["turn", str(told), "--angle", "45", "--out", turned]) == 0
    assert main(["evaluate", turned, "--world", "intersection", "--episodes", "3"]) == 0
    capsys.readouterr()
    assert main([*command, "--calibrated", str(told)]) == 2
    assert "told.safetensors" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [("0",), ("0", "1")])
def test_a_dial_of_another_road_is_trained_and_driven(seeds, tmp_path, capsys):
    """The roundabout's dial sees its clock, whether its runs act alone or side by side."""
    data, out = tmp_path / "data.safetensors", tmp_path / "run"
    drivers = [
        word
        for name in ("wait", "go")
        for word in ("--driver", policy_file(tmp_path, name, features=35, actions=5))
    ]
    collect = ["collect", "socialiq/Roundabout-v1", *drivers, "--episodes", "2"]
    assert main([*collect, "--out", str(data)]) == 0
    train = [
        "train",
        "dial",
        str(data),
        "--world",
        "roundabout",
        "--seed",
        *seeds,
        "--out",
        str(out),
    ]
    small = [
        "--updates",
        "2",
        "--hidden",
        "8",
        "--set",
        "expert_batch=4",
        "--set",
        "replay_batch=4",
    ]
    assert main([*train, *small, "--set", "replay_capacity=3000"]) == 0
    record = json.loads((out / "run.json").read_text())
    assert record["structure"]["redraw_times"] == 11 and len(record["dials"]) == len(seeds)
    dial = str(out / "dial_0.safetensors")
    told = str(tmp_path / "told.safetensors")
    command = ["dial", "roundabout", "--policy", dial, "--every", "45", "--episodes", "6"]
    capsys.readouterr()
    assert main([*command, "--calibrated", told, "--json"]) == 0
    first, *_ = json.loads(capsys.readouterr().out)["angles"]
    evaluate = ["evaluate", dial, "--world", "roundabout", "--episodes", "6", "--json"]
    for more in ([], ["--processes", "1"]):
        assert main([*evaluate, *more]) == 0
        same = json.loads(capsys.readouterr().out)
        assert same["r_env"] == pytest.approx(first["r_env"], abs=1e-9)
        assert same["r_social"] == pytest.approx(first["r_social"], abs=1e-9)
    assert main(["dial", "intersection", "--policy", dial]) == 2
    assert "the intersection has 70 and 3" in capsys.readouterr().err


def policy_file(folder, name, features=70, actions=3):
    """File of a small network."""
    network = QNetwork.initialise(jax.random.key(len(name)), features, (4,), actions)
    path = folder / f"{name}.safetensors"
    QPolicy.of(network, 0.1, {}).save(path)
    return str(path)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["crossing7", "--preset", "intersection"], "is not for crossing7: choose online,"),
        (["intersection", "--preset", "online"], "is not for intersection: choose intersection"),
        (["intersection"], "collect intersection --driver FILE"),
        (["merge"], "collect merge --driver FILE"),
        (["merge", "--preset", "online"], "is not for merge: choose intersection"),
        (["roundabout", "--angle", "45", "--budget", "1"], "train in a gridworld"),
        (["intersection", "--angle", "45", "--budget", "1"], "train in a gridworld"),
        (["nowhere"], "crossing5, crossing7"),
    ],
)
def test_what_does_not_fit_the_world_is_refused(words, line, tmp_path, capsys):
    assert main(["train", "dial", "--world", *words, "--out", str(tmp_path / "run")]) == 2
    assert line in capsys.readouterr().err
