"""Presets of continuous actions are the settings of the committed results."""

import dataclasses
import json
from typing import Any

import pytest

from socialiq.cli.main import main
from socialiq.learners.continuous.config import NAME, PRESETS
from socialiq.nn.actor_policy import ActorDial
from socialiq.storage import packaged_results, read_json


def as_json(config: Any) -> dict[str, Any]:
    return json.loads(json.dumps(dataclasses.asdict(config)))


@pytest.mark.parametrize(
    ("learner", "structure", "numbers"),
    [("sac", "continuous", "numbers"), ("iq-learn", "longer", "longer_numbers")],
)
def test_settings_are_those_of_the_study(learner, structure, numbers):
    committed = read_json(packaged_results() / NAME / "config.json")["config"]
    static, given = PRESETS[NAME][learner]
    for config, theirs in ((static, committed[structure]), (given, committed[numbers])):
        # An option that is younger than the results has its default.
        assert as_json(config) == as_json(type(config)()) | theirs


def test_the_study_s_experts_differ_in_what_counts_in_a_dial_alone():
    committed = read_json(packaged_results() / NAME / "config.json")["config"]["expert"]
    static = as_json(PRESETS[NAME]["sac"][0])
    assert {name for name in static if static[name] != committed[name]} == {"high_share"}


@pytest.mark.slow
def test_a_preset_is_laid_under_the_options(tmp_path, as_a_user_runs_it):
    words = ["train", "sac", "--world", f"{NAME}-steering", "--preset", NAME]
    small = [
        "--hidden",
        "8",
        "--set",
        "batch_size=8",
        "--updates",
        "2",
        "--set",
        "updates_per_round=2",
    ]
    assert main([*words, *small, "--set", "dial=true", "--out", str(tmp_path / "run")]) == 0
    dial = ActorDial.load(tmp_path / "run" / "dial_0.safetensors")
    assert (dial.n_features, dial.action_size) == (71, 2)  # the preset's view and clock
    assert dial.turned.weights[0].shape[0] == 8
