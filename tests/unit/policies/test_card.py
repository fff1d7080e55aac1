"""Model cards: what is recorded stands there, what isn't is visibly blank, nothing is markup."""

import json
import re
import sys

import jax
import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.policies.card import BLANK, model_card
from socialiq.worlds.intersection import atlas

HOSTILE = "<script>alert(1)</script> | [x](javascript:a) `c` \u202e\n# **bold** {{ 7*7 }}"


def policy(**provenance):
    weight, bias = np.ones((3, 7), np.float32), np.zeros(3, np.float32)
    return QPolicy((weight,), (bias,), "relu", 0.5, provenance)


def front_of(card):
    """The front matter, read as the JSON that each of its values is."""
    found = re.match(r"---\n(.*?)\n---\n", card, re.DOTALL)
    assert found is not None
    lines = found[1].splitlines()
    pairs = [line.split(": ", 1) for line in lines if not line.startswith("#")]
    return {key: json.loads(value) for key, value in pairs}


def test_what_is_recorded_stands_there():
    card = model_card(
        policy(learner="iq_learn", numbers={"angle": 45.0, "strength": 0.1}),
        "mine",
        training={"world": "crossing7", "data": {"file": "m.safetensors", "sha256": "ab12"}},
        evaluation={"method": "exact", "r_env": 1.5, "angle": 41.25},
        evaluated_by="By hand.",
    )
    for line in (
        "# mine",
        "social angle of\n45.0°",
        "| World | crossing7 |",
        "| Learner | iq\\_learn |",
        "| Network | 7-3, relu |",
        "| data.sha256 | ab12 |",
        "| numbers.strength | 0.1 |",
        "| r\\_env | 1.5 |",
        "By hand.",
    ):
        assert line in card, line
    front = front_of(card)
    assert front["social_angle_degrees"] == 45.0
    (result,) = front["model-index"][0]["results"]
    assert result["dataset"]["name"] == "crossing7"
    assert result["metrics"] == [{"type": "r_env", "value": 1.5}, {"type": "angle", "value": 41.25}]


def test_what_is_not_recorded_is_blank():
    full = model_card(policy(numbers={"angle": 1.0}), "x", evaluation={"r_env": 1.0})
    bare = model_card(policy(), "x")
    assert bare.count(BLANK) > full.count(BLANK) >= 7
    for line in (
        f"| Licence | {BLANK} |",
        f"{BLANK} No hash of training data was recorded",
        f"{BLANK} The file has no record of how it was made",
        f"{BLANK} No evaluation was given",
        "No social angle is declared",
    ):
        assert line in bare, line
    assert "model-index" not in front_of(bare) and "social_angle_degrees" not in front_of(bare)


def test_text_from_outside_is_no_markup():
    card = model_card(
        policy(**{"learner": HOSTILE, HOSTILE: {HOSTILE: HOSTILE}}),
        HOSTILE,
        training={"world": HOSTILE, "data": {HOSTILE: HOSTILE}},
        evaluation={HOSTILE: 1.0, "b": HOSTILE},
        evaluated_by=HOSTILE,
    )
    body = card.split("\n---\n", 1)[1]
    assert not re.search(r"(?<!\\)<", body) and "\u202e" not in card and "49" not in body
    assert not re.search(r"(?<!\\)[`\[]x?", body.replace(BLANK, ""))
    assert "\n# **bold" not in card and "\n# \\*\\*bold" not in card
    for line in body.splitlines():
        if line.startswith("|"):
            assert len(re.findall(r"(?<!\\)\|", line)) == 3, line
    front = front_of(card)
    assert front["model-index"][0]["results"][0]["dataset"]["name"].startswith("<script>")
    assert card.count("\n---\n") == 1


@pytest.mark.parametrize("told", ["45", True, float("nan"), None, [45.0]])
def test_an_angle_that_is_no_number_is_none(told):
    assert "No social angle is declared" in model_card(policy(angle=told), "x")


def test_long_records_are_cut():
    card = model_card(policy(**{f"setting_{n}": n for n in range(5_000)}), "x")
    assert card.count("setting\\_") == 300 and "more than can be listed" in card


@pytest.mark.parametrize(
    ("evaluation", "match"),
    [
        ({"policies": [], "pooled": {}}, "of several policies"),
        ({"a": [1]}, "one object of names and numbers"),
        ({}, "one object of names and numbers"),
    ],
)
def test_other_evaluations_are_refused(evaluation, match):
    with pytest.raises(UserError, match=match):
        model_card(policy(), "x", evaluation=evaluation)


def exported(tmp_path, *arguments):
    out = tmp_path / "card.md"
    assert main(["export", *arguments, "--format", "card", "--out", str(out)]) == 0
    return out.read_text()


def test_a_policy_of_the_atlas_brings_its_study_along(tmp_path):
    card = exported(tmp_path, "set_egoistic")
    assert "socialiq reproduce intersection-networks" in card
    assert "By the study that made it" in card and "| greedy" not in card
    assert atlas.load("set_egoistic").sha256 in card


def test_a_run_beside_the_policy_tells_its_data(tmp_path):
    path = tmp_path / "policy_0.safetensors"
    sha256 = policy(learner="iq_learn").save(path)
    run = {"world": "crossing7", "data": {"sha256": "d" * 64}, "policies": [{"sha256": sha256}]}
    (tmp_path / "run.json").write_text(json.dumps(run))
    assert "d" * 64 in exported(tmp_path, str(path))
    (tmp_path / "card.md").unlink()
    run["policies"] = [{"sha256": "of another"}]
    (tmp_path / "run.json").write_text(json.dumps(run))
    assert "d" * 64 not in exported(tmp_path, str(path))


def test_a_dials_card_is_of_one_angle(tmp_path):
    made = DialNetwork.initialise(jax.random.key(0), 7, (4,), 3)
    path = tmp_path / "dial.safetensors"
    DialPolicy.of(made, 1.0, 0.0, 90.0, {"learner": "dial"}).save(path)
    card = exported(tmp_path, str(path), "--angle", "30")
    assert "# dial at 30 degrees" in card and "Declared: 30.0°" in card


def test_an_evaluation_comes_with_its_hash(tmp_path):
    path = tmp_path / "policy.safetensors"
    policy().save(path)
    (tmp_path / "found.json").write_text('{"r_env": 2.25}')
    card = exported(tmp_path, str(path), "--evaluation", str(tmp_path / "found.json"))
    assert "| r\\_env | 2.25 |" in card and "It does not name its policy" in card


def test_what_cannot_be_exported_is_one_line(tmp_path, capsys, monkeypatch):
    policy().save(tmp_path / "policy.safetensors")
    made = DialNetwork.initialise(jax.random.key(0), 7, (4,), 3)
    dial, plain, out = tmp_path / "d.safetensors", tmp_path / "policy.safetensors", tmp_path / "o"
    DialPolicy.of(made, 1.0, 0.0, 90.0, {}).save(dial)
    for mend, arguments in {
        "choose one of onnx, torch, card": (plain, "--format", "pickle"),
        "name a file, or one of": ("absent", "--format", "card"),
        "add --angle": (dial, "--format", "card"),
        "choose one in [0, 90]": (dial, "--format", "card", "--angle", 91),
        "leave --angle out": (plain, "--format", "card", "--angle", 3),
        "add --format card": (plain, "--format", "torch", "--evaluation", dial),
        "as JSON": (plain, "--format", "card", "--evaluation", plain),
        "not a socialiq file": (tmp_path / "f", "--format", "card"),
    }.items():
        (tmp_path / "f").write_bytes((16).to_bytes(8, "little") + b"{}              ")
        assert main(["export", *map(str, arguments), "--out", str(out)]) == 2
        captured = capsys.readouterr()
        assert mend in captured.err and captured.err.count("\n") == 1
        assert not out.exists()
    monkeypatch.setitem(sys.modules, "onnx", None)
    assert main(["export", str(plain), "--format", "onnx", "--out", str(out)]) == 2
    assert "pip install 'socialiq[onnx]'" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "torch", None)
    from socialiq.policies.export import as_torch_module

    with pytest.raises(UserError, match=r"pip install 'socialiq\[torch\]'"):
        as_torch_module(policy())
