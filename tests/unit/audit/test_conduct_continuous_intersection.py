"""Audits at the intersection with continuous actions, from declaration to replayed episodes."""

import json
from pathlib import Path

import jax
import numpy as np
import pytest

from socialiq.audit.profile.profile import world_of
from socialiq.audit.profile.template import possible_loss
from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.nn.actor import Actor
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.options import ContinuousOptions

WORLD = "intersection-continuous"
STEERED = f"{WORLD}-steering"

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


@pytest.fixture
def audited(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "driver.py").write_text("def half(seen):\n    return 0.0 * seen[:, :1] + 0.5\n")

    def run(policy, *more, world=WORLD):
        new = ["profile", "new", "--world", world, "--angle", "45", "--out", "p.toml", "--replace"]
        assert main(new) == 0
        given = ["--profile", "p.toml", "--episodes", "30", "--seed", "7", "--out", "out"]
        found = main(["audit", policy, *given, "--replace", *more])
        assert found in (0, 1, 3), capsys.readouterr().err
        return json.loads((tmp_path / "out/report.json").read_text())

    return run


def test_an_expert_is_compared_replayed_and_verified(audited, capsys):
    report = audited("atlas:expert_prosocial", "--shift")
    assert report["policy"]["record"]["action_size"] == 1
    assert report["left_out"][0]["name"] == "expert_prosocial"
    names = {one["name"] for one in report["references"]}
    assert names == {"go", "wait", "idm", "gap_2s", "gap_3s", "gap_4s"} | {
        "expert_egoistic",
        "expert_altruistic",
    }
    assert [one["name"] for one in report["trivial"]] == ["trivial_random"]
    traces = [one["trace"] for rows in report["episodes"].values() for one in rows]
    assert len(traces) == 6 and all(one["tracks"][0]["ego"] for one in traces)
    assert report["declaration"]["margin"]["largest_loss"] > 100.0
    assert main(["audit", "verify", "out", "--rerun", "--policy", "atlas:expert_prosocial"]) == 0
    html = Path("out/report.html").read_text()
    assert "trained for 0°" in html and "simpler network" not in html
    told = Path("out/credibility.md").read_text().split()
    assert "held until the next decision" in " ".join(told)


def test_rules_dials_and_code_are_audited(audited, tmp_path):
    actor = Actor.initialise(jax.random.key(0), 71 + 2, (4,), 1)
    ActorDial(ActorPolicy.of(actor, {}), 0.0, 90.0).save(tmp_path / "dial.safetensors")
    found = audited("dial.safetensors", "--reference", "dial.safetensors")
    assert [15.0] in [one["angles"] for one in found["references"]]
    assert audited("idm")["left_out"][0]["name"] == "idm"
    code = audited("python:driver.py:half", "--allow-code", "--isolation", "none")
    assert code["consistency"]["repeated"]["differing"] == 0
    steered = audited("go", world=STEERED)
    # The experts only accelerate.
    assert not [one for one in steered["references"] if one["name"].startswith("expert")]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["atlas:prosocial"], "choose one of expert_egoistic"),
        (["go", "--reference", "python:driver.py:half"], "--allow-code|allow that"),
    ],
)
def test_mistakes_are_one_line(audited, capsys, words, says):
    audited("go")
    capsys.readouterr()
    given = ["--profile", "p.toml", "--episodes", "20", "--seed", "7", "--out", "other"]
    assert main(["audit", *words, *given, "--isolation", "none"]) == 2
    told = capsys.readouterr().err
    assert any(one in told for one in says.split("|")) and told.count("\n") == 1


def test_the_world_of_an_id_is_named_plainly():
    with pytest.raises(UserError, match="intersection-continuous"):
        world_of("socialiq/IntersectionContinuous-v1", {})
    with pytest.raises(UserError, match="unknown option of intersection-continuous 'actions'"):
        world_of(WORLD, {"actions": "continuous_steering"})


def test_the_largest_loss_is_unknown_where_the_ego_steers_along_a_turn():
    assert possible_loss(world_of(STEERED, {}), 0.0) == possible_loss(world_of(WORLD, {}), 0.0)
    assert possible_loss(world_of(STEERED, {"destination": "left"}), 0.0) is None


@pytest.mark.parametrize("size", [1, 2])
@pytest.mark.parametrize("name", policies.NAMES)
def test_rules_accelerate_within_the_bounds_and_never_drive_backwards(name, size):
    kind = ("continuous", "continuous_steering")[size - 1]
    options = ContinuousOptions(actions=kind)
    batch = world_of((WORLD, STEERED)[size - 1], {}).batch(20)
    driver, slowest = policies.policy(name, 3, options), 0.0
    batch.reset(5)
    for _ in range(12):
        action, _ = driver.predict(batch.observation)
        assert action.shape == (20, size) and action.dtype == np.float32
        batch.step(action)
        ego = batch.buffers.episodes["controlled"][:, 0]
        slowest = min(slowest, batch.buffers.vehicles["speed"][np.arange(20), ego].min())
    assert slowest > -1e-3 or name == "random"
