"""Audits at a recorded junction: the crossing made by hand."""

import dataclasses
import json

import equinox as eqx
import jax
import numpy as np
import pytest

from socialiq.audit.evidence.collect import junction_strata
from socialiq.audit.evidence.drive import Course, UniformPolicy
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.profile.profile import scenario_sha256, world_of
from socialiq.audit.seeds import episode_seeds
from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Ending
from socialiq_recordings.world.config import WorldConfig
from socialiq_recordings.world.gym import RecordedJunctionEnv
from socialiq_recordings.world.recorded_world import RecordedWorld


class Wait:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros(len(observation), np.int64), state


class AsDriver(Wait):
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full(len(observation), -1), state


class Timed(Wait):
    def __init__(self, n_features):
        self.n_features = n_features

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        assert observation.shape[1] == self.n_features
        return np.where(observation[:, -1] < 3, 0, 5), state


def waiting(world_file) -> QPolicy:
    """Return a policy whose values are all 0, so that it chooses the first action: it brakes."""
    world = RecordedWorld.load(world_file)
    network = QNetwork.initialise(jax.random.key(0), world.n_features, (4,), world.n_actions)
    zero = jax.tree.map(lambda leaf: 0 * leaf if eqx.is_array(leaf) else leaf, network)
    return QPolicy.of(zero, 1.0, {})


def test_episodes_are_those_of_the_environment(world_file):
    junction, seeds = world_of(str(world_file), {}), episode_seeds(50_000_000, 20)
    policy = Timed(junction.n_features + 1)
    found = Course(junction, seeds, 3).drive(Reference("timed", policy))
    env = RecordedJunctionEnv(world_file, clock=True)
    for row, seed in enumerate(seeds.tolist()):
        seen, _ = env.reset(seed=seed)
        totals, ended, length, info = np.zeros(2), False, 0, {}
        while not ended:
            action = policy.predict(seen[None])[0][0]
            seen, _, terminated, truncated, info = env.step(action)
            totals += info["reward_pair"]
            ended, length = terminated or truncated, length + 1
        assert found.totals[row] == pytest.approx(totals)
        assert Ending(int(found.episodes.ending[row])).name.lower() == info["ending"]
        assert found.episodes.length[row] == length


def test_the_calibrated_driver_arrives_and_waiting_never_does(world_file):
    junction, seeds = world_of(str(world_file), {}), episode_seeds(50_000_000, 40)
    course = Course(junction, seeds)
    driver, go, wait = (
        course.drive(Reference(name, junction.driver(name))) for name in junction.references
    )
    assert driver.name == "driver" and driver.episodes.arrival.all()
    assert wait.episodes.timeout.any() and not wait.episodes.collision.any()
    assert go.episodes.at_fault.any()
    assert driver.mean.env > wait.mean.env


def test_no_policy_drives_as_the_population(world_file):
    junction = world_of(str(world_file), {})
    with pytest.raises(UserError, match="chose action -1"):
        Course(junction, episode_seeds(0, 20)).drive(Reference("sly", AsDriver()))


def test_draws_of_a_soft_policy_do_not_depend_on_the_batch(world_file):
    junction, seeds = world_of(str(world_file), {}), episode_seeds(50_000_000, 20)
    driver = Reference("random", UniformPolicy(junction.n_actions))
    few, many = (Course(junction, seeds, n).drive(driver, False) for n in (2, 20))
    assert np.array_equal(few.totals, many.totals)


def test_strata_count_the_other_rows():
    seen = np.zeros((2, 10, 7), np.float32)
    seen[1, :6, 0] = 1.0
    assert junction_strata(seen.reshape(2, -1))["density"].tolist() == ["0 to 3", "4 to 7"]


def test_the_hash_is_of_the_content_and_not_of_the_path(made, world_file, tmp_path):
    copy, other = tmp_path / "copy.safetensors", tmp_path / "other.safetensors"
    copy.write_bytes(world_file.read_bytes())
    dataclasses.replace(made.world, config=WorldConfig(duration=10.0)).save(other)
    hashes = [scenario_sha256(world_of(str(path), {})) for path in (world_file, copy, other)]
    assert hashes[0] == hashes[1] != hashes[2]


def test_an_audit_from_the_command_line(world_file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "w.safetensors").write_bytes(world_file.read_bytes())
    new = ["profile", "new", "--world", "w.safetensors", "--angle", "0", "--margin", "0.5"]
    assert main([*new, "--out", "p.toml"]) == 0
    assert main(["profile", "check", "p.toml"]) == 0
    waiting(world_file).save(tmp_path / "waiting.safetensors")
    call = ["audit", "waiting.safetensors", "--profile", "p.toml"]
    capsys.readouterr()
    assert main([*call, "--episodes", "40", "--seed", "50000000", "--out", "a", "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["policy"]["means"]["timeout"] == 1.0
    assert [one["name"] for one in report["references"]] == ["driver", "go", "wait"]
    assert "none of them is a person" in report["limits"][0]
    (tmp_path / "w.safetensors").unlink()  # a report is verified without the world
    assert main(["audit", "verify", "a"]) == 0
    assert "Intelligent Driver Model" in (tmp_path / "a" / "credibility.md").read_text()
    capsys.readouterr()
    assert main(["profile", "check", "p.toml"]) == 2
    written = capsys.readouterr().err
    assert "no such file: w.safetensors" in written and written.count("\n") == 1


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (("w.safetensors", "p.safetensors"), "no such file"),
        (("w.safetensors", "other.safetensors"), "is of another world"),
        (("w.safetensors", "junk.safetensors"), "a recording can't be driven in"),
        (("[scenario.options]", "[scenario.options]\nclock = true"), "takes no options, got clock"),
        (("w.safetensors", "w:1.safetensors"), "scenario.world must be one of"),
    ],
)
def test_a_wrong_world_is_one_line(made, world_file, tmp_path, monkeypatch, capsys, change, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "w.safetensors").write_bytes(world_file.read_bytes())
    dataclasses.replace(made.world, config=WorldConfig(duration=10.0)).save(
        tmp_path / "other.safetensors"
    )
    (tmp_path / "junk.safetensors").write_bytes(b"junk")
    assert main(["profile", "new", "--world", "w.safetensors", "--angle", "0"]) == 0
    declared = (tmp_path / "profile.toml").read_text()
    (tmp_path / "profile.toml").write_text(declared.replace(*change))
    capsys.readouterr()
    assert main(["profile", "check", "profile.toml"]) == 2
    written = capsys.readouterr().err
    assert line in written and written.count("\n") == 1
