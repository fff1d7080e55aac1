"""`improve-dial`: runs that begin with a dial, and dials that it refuses."""

import json

import jax
import pytest

from socialiq.cli.main import main
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.worlds.intersection.options import Options

SHORT = [
    "--updates",
    "3",
    "--set",
    "states_per_update=1",
    "--set",
    "first_rounds=1",
    "--set",
    "batch_size=8",
]


def dial(path, pairs=True, n_features=71, view="set"):
    times = Options().decisions if view == "set" else 0
    network = DialNetwork.initialise(
        jax.random.key(0), n_features, (8,), 3, view=view, times=times, pairs=pairs
    )
    DialPolicy.of(network, 0.03, 0.0, 90.0, {}).save(path)
    return path


@pytest.mark.parametrize("agents", [1, 3])
def test_a_dial_is_improved_into_a_folder(tmp_path, capsys, agents):
    begun, out = dial(tmp_path / "dial.safetensors"), tmp_path / "out"
    arguments = [
        "train",
        "improve-dial",
        str(begun),
        "--out",
        str(out),
        "--seed",
        "4",
        "--json",
        *SHORT,
    ]
    assert main([*arguments, "--environments", "8", "--agents", str(agents)]) == 0
    assert json.loads(capsys.readouterr().out)["dials"][0]["seed"] == 4
    better = DialPolicy.load(out / "dial_0.safetensors")
    assert better.pairs and (better.low, better.high, better.n_features) == (0.0, 90.0, 71)
    record = json.loads((out / "run.json").read_text())
    assert record["structure"]["hidden"] == [8] and record["structure"]["times"] == 20
    assert record["agents"] == agents
    assert better.provenance["start"]["sha256"] == DialPolicy.load(begun).turned.sha256


def test_a_dial_may_be_improved_at_a_single_angle(tmp_path):
    begun, out = dial(tmp_path / "dial.safetensors"), tmp_path / "out"
    angle = ["--set", "low=45", "high=45", "high_share=none"]
    run = ["train", "improve-dial", str(begun), "--out", str(out), *SHORT, "--environments", "8"]
    assert main([*run, *angle]) == 0
    better = DialPolicy.load(out / "dial_0.safetensors")
    assert (better.low, better.high) == (45.0, 45.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"pairs": False}, "no pair of values"),
        ({"n_features": 30, "view": "flat"}, "give one of the intersection"),
    ],
)
def test_another_dial_is_refused_in_a_line(tmp_path, capsys, changes, said):
    begun, out = dial(tmp_path / "dial.safetensors", **changes), tmp_path / "out"
    assert main(["train", "improve-dial", str(begun), "--out", str(out)]) == 2
    assert said in capsys.readouterr().err and not out.exists()


def test_bad_numbers_are_refused_before_the_folder_is_made(tmp_path, capsys):
    begun, out = dial(tmp_path / "dial.safetensors"), tmp_path / "out"
    nowhere = ["--set", "low=95", "high=99", "high_share=none"]
    bad = (
        nowhere,
        ["--environments", "0"],
        ["--set", "high_share=2"],
        ["--updates", "0"],
        ["--agents", "0"],
    )
    for options in (*bad, ["--agents", "20"], ["--agents", "4", "--world", "intersection-caused"]):
        assert main(["train", "improve-dial", str(begun), "--out", str(out), *options]) == 2
        name = options[1].partition("=")[0] if options[0] == "--set" else options[0][2:]
        assert name in capsys.readouterr().err and not out.exists()
