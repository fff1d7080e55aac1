"""Every mistake: one line on standard error with the remedy, status 2, nothing half-written."""

import json
import os
import sys

import jax
import numpy as np
import pytest
import safetensors.numpy

from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.learners.callbacks import TRACKERS
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.outputs import claimed
from socialiq.storage import packaged_results

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "mixed.safetensors"
    assert main(["collect", "crossing7", "--episodes", "2", "--out", str(path)]) == 0
    return path


def refused(capsys, *arguments):
    """Run a command that must be refused; returns its line."""
    assert main([str(argument) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("socialiq: ") and captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize(
    ("arguments", "mend"),
    [
        (["solve", "crossing9"], "choose one of crossing5, crossing7"),
        (["solve", "crossing7", "--angle", "400"], "outside [0, 360) degrees"),
        (["solve", "crossing7", "--angle", "-1"], "outside [0, 360) degrees"),
        (["solve", "crossing7", "--angle", "nan"], "give 0, or a number of size 1e-100 to 1e+100"),
        (["solve", "crossing7", "--angle", "east"], "--angle east: give a number"),
        (["solve"], "socialiq solve --help"),
        (["sovle", "crossing7"], "socialiq --help lists the commands"),
        (["reproduce", "fig7"], "choose one of alternatives, audit-angles"),
        (["claims", "--verdict", "maybe"], "choose one of reproduced, adopted, partly"),
        (["bench", "cars"], "choose one of learners, continuous, devices, worlds"),
        (["solve", "intersection"], "can't be listed"),
        (["predict-lambda", "intersection"], "can't be listed"),
        (["predict-lambda", "crossing7", "--angle", "-5"], "outside [0, 360) degrees"),
        (["predict-lambda", "crossing7", "--target-kind", "running"], "not a function of state"),
        (["predict-lambda", "crossing7", "--target-kind", "total"], "choose one of instantaneous"),
        (["front", "intersection"], "choose one of crossing5, crossing7"),
        (
            ["collect", "intersection", "--out", "x"],
            "has no exact experts: give a --driver for each mode",
        ),
        (["render", "intersection", "--angle", "3", "--out", "x.png"], "add --driver"),
        (["render", "crossing5", "--driver", "go", "--out", "x.png"], "use --angle"),
        (["render", "intersection", "--driver", "tom", "--out", "x.png"], "choose one of go, idle"),
        (["render", "intersection", "--out", "x.gif"], "add --driver"),
        (["render", "intersection", "--out", "x.bmp"], "choose one of .png, .gif, .mp4"),
        (["render", "crossing5", "--out", "x.gif"], "choose one of .png"),
        (["render", "intersection", "--seed", "-1", "--out", "x.png"], "seed must be at least 0"),
        (["reproduce", "poc", "--episodes", "5"], "unknown option --episodes"),
        (["reproduce", "poc", "--set", "episodes=5"], "choose one of seeds, strength, updates"),
        (["reproduce", "poc", "--set", "updates"], "--set takes KEY=VALUE, got 'updates'"),
        (["reproduce", "poc", "--set", "updates=x"], "updates must be an integer, got 'x'"),
        (["reproduce", "poc", "--set", "readings=2"], "unknown readings '2': choose one of true"),
        (["reproduce", "poc", "--preset", "small"], "unknown preset 'small': choose one of tiny"),
        (["reproduce", "audits", "--seeds", "3"], "there is no setting seeds: choose one of epi"),
        (["reproduce", "intersection-world", "--set", "back_end=x"], "choose one of core, highway"),
        (["reproduce", "intersection-world", "--set", "episodes=0"], "at least 1, got 0"),
        (["conformance", "--seed", "-1"], "seed must be at least 0"),
        (["conformance", "--population", "x"], "choose one of highway_env, thesis"),
        (["conformance", "--episodes", "0"], "episodes must be at least 1"),
        (["conformance", "--actions", "x"], "--actions x: choose one of "),
        (["conformance", "--scene", "x"], "--scene x: choose one of intersection, merge"),
        (["conformance", "--scene", "merge", "--population", "thesis"], "leave it out with merge"),
        (["conformance", "--agents", "5"], "--agents takes 1 to 4, got 5"),
        (["conformance", "--scene", "merge", "--agents", "2"], "leave it out with merge"),
        (["evaluate", "nowhere.safetensors"], "no such file: nowhere.safetensors"),
        (["evaluate", "policy.onnx"], "no such file: policy.onnx"),
        (["evaluate", "gap_3s", "--world", "merge", "--episodes", "3"], "choose one of go, idle"),
        (
            ["train", "cql", "nowhere.safetensors", "--out", "x"],
            "no such file: nowhere.safetensors",
        ),
    ],
)
def test_unknown_names_and_numbers(capsys, tmp_path, monkeypatch, arguments, mend):
    monkeypatch.chdir(tmp_path)
    assert mend in refused(capsys, *arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "mend"),
    [
        (["--world", "crossing9"], "choose one of crossing5, crossing7"),
        (["--world", "crossing5"], "they belong to another world"),
        (["--world", "crossing7", "--preset", "best"], "choose one of table-c1"),
        (["--world", "crossing7", "--set", "target_kind=sum"], "choose one of running, to_go"),
        (["--world", "crossing7", "--prior", "social"], "choose one of none, reward"),
        (["--world", "crossing7", "--divergence", "tv"], "choose one of chi2, kl"),
        (["--world", "crossing7", "--strength", "-1"], "strength must be 0 or more"),
        (["--world", "crossing7", "--strength", "nan"], "--strength nan: give 0, or a number"),
        (["--world", "crossing7", "--angle", "361"], "outside [0, 360) degrees"),
        (["--world", "crossing7", "--set", "timeout=never"], "choose one of zero, bootstrap"),
        (["--world", "crossing7", "--set", "temperature=0"], "temperature must be above 0"),
        (["--world", "crossing7", "--set", "discount=1"], "discount must lie in [0, 1)"),
        (["--world", "crossing7", "--updates", "0"], "updates must be at least 1"),
        (["--value-term", "value"], "set value_term (--value-term) to value_expert or v0"),
        (["--resume", "--world", "crossing7"], "no such file"),
    ],
)
def test_settings_that_make_no_run(capsys, tmp_path, data, options, mend):
    out = tmp_path / "run"
    assert mend in refused(capsys, "train", "iq-learn", data, "--out", out, *options)
    assert not out.exists()


def test_an_output_folder_that_exists(capsys, tmp_path, data):
    out = tmp_path / "run"
    out.mkdir()
    (out / "mine.txt").write_text("keep me")
    line = refused(capsys, "train", "iq-learn", data, "--world", "crossing7", "--out", out)
    assert "exists already: name a new folder" in line
    assert (out / "mine.txt").read_text() == "keep me"
    line = refused(capsys, "reproduce", "worlds", "--out", out)
    assert "exists already" in line
    line = refused(capsys, "reproduce", "worlds", "--out", out, "--replace")
    assert "is not a results folder" in line
    assert (out / "mine.txt").read_text() == "keep me"


def test_an_output_place_that_cannot_be_written(capsys, tmp_path, data):
    file = tmp_path / "file"
    file.write_text("")
    line = refused(capsys, "train", "iq-learn", data, "--world", "crossing7", "--out", file / "run")
    assert "cannot make" in line
    assert "cannot make" in refused(capsys, "render", "crossing5", "--out", file / "a.png")
    assert [*tmp_path.iterdir()] == [file]


def test_an_output_file_that_exists(capsys, tmp_path):
    out = tmp_path / "data.safetensors"
    out.write_text("keep me")
    assert "exists already" in refused(capsys, "collect", "crossing5", "--out", out)
    assert out.read_text() == "keep me"


def test_damaged_demonstrations(capsys, tmp_path, data):
    whole = data.read_bytes()
    cases = {
        "truncated": whole[: len(whole) // 2],
        "flipped": whole[:-10] + bytes([whole[-10] ^ 1]) + whole[-9:],
        "empty": b"",
        "text": b"observation,action\n",
    }
    for name, content in cases.items():
        path = tmp_path / name
        path.write_bytes(content)
        line = refused(
            capsys, "train", "iq-learn", path, "--world", "crossing7", "--out", tmp_path / "run"
        )
        assert "damaged" in line
    assert not (tmp_path / "run").exists()


def test_demonstrations_of_another_version(capsys, tmp_path, data, monkeypatch):
    table = files.load(data)
    path = tmp_path / "old.safetensors"
    with monkeypatch.context() as patched:
        patched.setattr(files, "SCHEMA_VERSION", 99)
        files.save(path, table)
    line = refused(
        capsys, "train", "iq-learn", path, "--world", "crossing7", "--out", tmp_path / "run"
    )
    assert "version 99" in line and "make the file again" in line


def test_a_file_of_another_kind(capsys, tmp_path, data):
    assert "holds demonstrations, not policy" in refused(capsys, "evaluate", data)
    foreign = tmp_path / "foreign.safetensors"
    safetensors.numpy.save_file({"a": np.zeros(3, np.float32)}, foreign)
    assert "not a socialiq file" in refused(capsys, "evaluate", foreign)


def test_a_policy_for_another_world(capsys, tmp_path):
    path = tmp_path / "policy.safetensors"
    shapes = [(3, 9), (2, 3)]
    policy = QPolicy(
        tuple(np.zeros(shape, np.float32) for shape in shapes),
        tuple(np.zeros(shape[0], np.float32) for shape in shapes),
        "relu",
        1.0,
    )
    policy.save(path)
    assert "name the world it was made for" in refused(capsys, "evaluate", path)
    assert "add --episodes N" in refused(capsys, "evaluate", path, "--world", "CartPole-v1")
    assert "name the world it was made for" in refused(
        capsys, "evaluate", path, "--world", "CartPole-v1", "--episodes", "1"
    )
    assert "registered Gymnasium id" in refused(
        capsys, "evaluate", path, "--world", "NoSuchWorld-v0", "--episodes", "1"
    )


def test_results_that_are_not_there(capsys, tmp_path):
    assert "is not a results folder" in refused(capsys, "reproduce", "poc", "--from", tmp_path)
    poc = packaged_results() / "poc"
    assert "holds poc: name that study" in refused(capsys, "reproduce", "grid", "--from", poc)
    assert "no such file" in refused(capsys, "claims", "--results", tmp_path)


def test_a_missing_extra(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    line = refused(capsys, "bench", "learners", "--repeats", "1")
    assert "pip install 'socialiq-lab[bench]'" in line


def test_missing_extras_of_doors(capsys, monkeypatch, tmp_path, data):
    out, events = tmp_path / "run", tmp_path / "events"
    for extra in TRACKERS:
        monkeypatch.setitem(sys.modules, extra, None)
        options = ("--value-term", "value_expert", f"--{extra}", events, "--out", out)
        line = refused(capsys, "train", "iq-learn", data, *options)
        assert f"pip install 'socialiq[{extra}]'" in line
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    line = refused(capsys, "render", "crossing5", "--out", tmp_path / "x.png")
    assert "pictures: matplotlib is not installed; run pip install 'socialiq[draw]'" in line
    for module in ("h5py", "minari"):
        monkeypatch.setitem(sys.modules, module, None)
        line = refused(capsys, "data", "to-minari", data, "--out", out)
        assert "pip install 'socialiq[minari]'" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "command",
    [
        ["conformance", "--default-numpy", "--episodes", "1"],
        ["reproduce", "intersection-world", "--set", "back_end=highway_env", "episodes=1"],
    ],
)
def test_a_missing_simulator(capsys, monkeypatch, tmp_path, command):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "highway_env", None)
    ours = "socialiq.worlds.intersection.reference", "socialiq.worlds.conformance"
    for name in [one for one in sys.modules if one.startswith(("highway_env.", *ours))]:
        monkeypatch.delitem(sys.modules, name)  # another test may have imported them
    assert main(command) == 2
    captured = capsys.readouterr()
    assert "pip install 'socialiq[highway]'" in captured.err.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


def test_json_failures_keep_standard_output_empty(capsys):
    assert main(["solve", "crossing7", "--angle", "999", "--json"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    with pytest.raises(json.JSONDecodeError):
        json.loads(captured.err)


def some_dial(folder):
    path = folder / "dial.safetensors"
    network = DialNetwork.initialise(jax.random.key(0), 7, (4,), 3)
    DialPolicy.of(network, 1.0, 0.0, 90.0, {}).save(path)
    return path


def test_dials_that_are_asked_for_the_impossible(capsys, tmp_path):
    dial, out = some_dial(tmp_path), tmp_path / "policy.safetensors"
    mends = {
        "choose one in [0, 90] degrees": ("turn", dial, "--angle", 91, "--out", out),
        "name the world it was trained for": ("dial", "crossing5", "--policy", dial),
        "give whole degrees": ("dial", "crossing7", "--policy", dial, "--every", 0),
        "no such file": ("dial", "crossing7", "--policy", tmp_path / "none"),
        "choose one of crossing5, crossing7": ("dial", "mars", "--policy", dial),
        "the intersection has 70 and 3": ("dial", "intersection", "--policy", dial),
        "seed must be at least 0": ("dial", "intersection", "--policy", dial, "--seed", -1),
        "the world has 70 and 3": ("evaluate", dial, "--world", "intersection", "--episodes", 1),
    }
    for mend, arguments in mends.items():
        assert mend in refused(capsys, *arguments)
    assert not out.exists()


@pytest.mark.parametrize(
    "command",
    [
        ("train", "iq-learn", "DATA", "--out", "OUT", "--seed"),
        (
            "train",
            "dial",
            "--world",
            "crossing7",
            "--preset",
            "online-alone",
            "--out",
            "OUT",
            "--seed",
        ),
        ("reproduce", "grid", "--out", "OUT", "--seeds"),
        ("reproduce", "intersection-dial", "--out", "OUT", "--seeds"),
        ("reproduce", "compare-priors", "--out", "OUT", "--seeds"),
        ("demo", "--out", "OUT", "--seeds"),
    ],
    ids=lambda command: " ".join(command[:3]),
)
def test_training_seeds_that_make_no_run(capsys, tmp_path, data, command):
    places = {"DATA": str(data), "OUT": str(tmp_path / "out")}
    given = [places.get(word, word) for word in command]
    assert "seed must be at least 0, got -1" in refused(capsys, *given, "-1")
    assert "seed must lie in [0, 2^32)" in refused(capsys, *given, str(2**32))
    assert "a seed is named twice: name each once" in refused(capsys, *given, "20", "20")
    assert [path for path in tmp_path.iterdir() if path != data] == []


def test_dials_that_cannot_be_trained(capsys, tmp_path, data):
    out = tmp_path / "run"
    mends = {
        "name their file": (),
        "leave the file out": (data, "--preset", "online-alone"),
        "is not for crossing7: choose online": ("--preset", "uphill"),
        "with a clock if it has one": (data,),
        "updates must be at least 1": (data, "--updates", -1),
        "add --angle": (data, "--budget", 0.1),
        "must be above 0": (data, "--angle", 45, "--budget", 0),
        "give more --updates": ("--angle", 45, "--budget", 1, "--updates", 250),
        "outside [0, 360)": (data, "--angle", 400),
    }
    for mend, options in mends.items():
        assert mend in refused(
            capsys, "train", "dial", *options, "--world", "crossing7", "--out", out
        )
        assert not out.exists()


DIGITS = "1" * 24


@pytest.mark.parametrize(
    ("arguments", "mend"),
    [
        (["collect", "crossing5", "--seed=-1", "--out", "OUT"], "seed must be at least 0, got -1"),
        (["collect", "crossing5", f"--seed={DIGITS}", "--out", "OUT"], "seed must be below 2^63"),
        (["collect", "crossing5", "--episodes", DIGITS, "--out", "OUT"], "at most 1,000,000,000"),
        (["collect", "crossing5", "--share=nan", "--out", "OUT"], "--share nan: give 0, or a"),
        (["collect", "crossing5", "--base", "x", "--out", "OUT"], "is of --mixture contaminated"),
        (["evaluate", "POLICY", "--seed=-1"], "seed must be at least 0, got -1"),
        (["evaluate", "POLICY", "--episodes", DIGITS], "at most 1,000,000,000"),
        (["evaluate", "a" * 5000], "File name too long"),
        (["evaluate", "caf\udce9"], "'caf?' is not UTF-8 text"),
        (["evaluate", "PIPE"], "not a regular file"),
        (["render", "crossing5", "--seed", DIGITS, "--out", "x.png"], "seed must be below 2^63"),
        (["claims", "--verdict", ""], "an empty word of --verdict"),
        (["claims", "--verdict="], "--verdict is empty"),
        (["data", "import", "commonroad", "PIPE", "--out", "OUT"], "not a regular file"),
        (["data", "import", "csv", "PIPE", "--columns", "ngsim", "--out", "OUT"], "not a regular"),
        (["data", "import", "csv", "x", "--columns", "PIPE.toml", "--out", "OUT"], "not a regular"),
        (["data", "from-arrays", "PIPE.csv", "--out", "OUT"], "not a regular file"),
        (["data", "from-arrays", "PIPE.npz", "--out", "OUT"], "not a regular file"),
        (["data", "demonstrations", "x", "--policy-rate", "0", "--out", "OUT"], "policy rate must"),
        (["sweep", "PIPE", "--out", "OUT"], "not a regular file"),
        (["sweep", "PIPE", "--out", "/"], "is no new place"),
        (["export", "POLICY", "--format=card", "--evaluation=PIPE", "--out", "OUT"], "not a regul"),
        (["audit", "POLICY", "--profile", "PIPE", "--out", "OUT"], "not a regular file"),
        (["audit", "verify", "x", "--policy", "x"], "--policy is of --rerun"),
        (["profile", "check", "PIPE"], "not a regular file"),
        (
            ["reproduce", "grid", "--set", "target_kinds=x", "--out", "OUT"],
            "unknown target kind 'x'",
        ),
        (
            ["reproduce", "grid", "--set", "strengths=", "--out", "OUT"],
            "--set strengths has no value",
        ),
        (
            ["reproduce", "theory", "--set", "random_worlds=-1", "--out", "OUT"],
            "must be at least 1",
        ),
        (["reproduce", "worlds", "--out", "."], "is no new place"),
    ],
    ids=lambda given: " ".join(word[:20] for word in given[:2]) if isinstance(given, list) else "",
)
def test_what_was_a_traceback_a_hang_or_accepted(capsys, tmp_path, monkeypatch, arguments, mend):
    places = {"OUT": tmp_path / "out", "POLICY": tmp_path / "policy.safetensors"}
    some_policy(places["POLICY"])
    for name in ("PIPE", "PIPE.toml", "PIPE.csv", "PIPE.npz"):
        places[name] = tmp_path / name
        os.mkfifo(places[name])
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    given = [str(places.get(word, word)) for word in arguments]
    given = [word.replace("=PIPE", f"={places['PIPE']}") for word in given]
    assert mend in refused(capsys, *given)
    assert sorted(tmp_path.iterdir()) == before


def test_seconds_that_no_clock_measures(capsys, tmp_path):
    policy = tmp_path / "policy.safetensors"
    some_policy(policy)
    call = ("audit", policy, "--profile", "x", "--out", tmp_path / "out", "--step-seconds")
    assert "--step-seconds 9.99989e-321: give 0, or a number" in refused(capsys, *call, "1e-320")
    assert "seconds for an answer must be" in refused(capsys, *call, "1e-9")


def test_an_output_that_another_process_writes(capsys, tmp_path):
    out = tmp_path / "out"
    with claimed(out):
        line = refused(capsys, "collect", "crossing5", "--episodes", 1, "--out", out)
    assert "another process is writing" in line
    assert main(["collect", "crossing5", "--episodes", "1", "--out", str(out)]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def some_policy(path):
    shapes = [(3, 5), (3, 3)]
    weights = tuple(np.zeros(shape, np.float32) for shape in shapes)
    biases = tuple(np.zeros(shape[0], np.float32) for shape in shapes)
    QPolicy(weights, biases, "relu", 1.0).save(path)
