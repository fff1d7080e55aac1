"""Driving jobs: whose episodes are written where."""

import numpy as np
import pytest

from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results
from socialiq.worlds.intersection import atlas
from socialiq_lab.intersection.driving import (
    FIRST_EPISODE,
    Driving,
    calibrate_dial,
    drive,
    drivers_of,
    episodes_at,
    evaluation,
    load_episodes,
)
from socialiq_lab.intersection.rows import evaluated, valued

DIAL = packaged_results() / "intersection-dial" / "dial.safetensors"


@pytest.fixture(name="trained", scope="module")
def trained_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained")
    (folder / "3").mkdir()
    atlas.load("egoistic").save(folder / "last.safetensors")
    atlas.load("expert_altruistic").save(folder / "3" / "last.safetensors")
    return folder


def test_a_rule_drives_without_an_input(tmp_path):
    shares: list[float] = []
    config = Driving(driver="gap_3s", episodes=3)
    drive(config, tmp_path, {}, shares.append)
    episodes = load_episodes(tmp_path / "gap_3s" / "greedy.safetensors")
    assert len(episodes.ending) == 3 and shares == [1.0]
    assert config.seeds.tolist() == [FIRST_EPISODE + number for number in range(3)]


def test_every_policy_of_a_folder_drives_by_each_readout(trained, tmp_path):
    config = Driving(readouts=("greedy", "soft"), episodes=2)
    drive(config, tmp_path, {"learners": trained}, lambda _share: None)
    written = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.safetensors")}
    assert written == {
        f"{policy}/{readout}.safetensors"
        for policy in ("last", "3/last")
        for readout in ("greedy", "soft")
    }
    assert episodes_at(tmp_path, "3/last.safetensors", "soft").is_file()
    assert set(drivers_of(Driving(driver="last.safetensors"), {"a": trained})) == {
        "last.safetensors"
    }


def test_a_dial_drives_at_each_angle_and_is_valued_there(tmp_path):
    folder = tmp_path / "dial"
    folder.mkdir()
    DialPolicy.load(DIAL).save(folder / "dial.safetensors")
    job = evaluation("dials/0", Driving(angles=(0.0, 90.0), episodes=3), cost=1.0)
    assert (job.name, job.inputs) == ("evaluation/dials/0", ("dials/0",))
    drive(job.config, tmp_path / "driven", {"dials/0": folder}, lambda _share: None)
    rows = [
        valued({"asked": angle}, episodes_at(tmp_path / "driven", "dial", angle), angle)
        for angle in (0.0, 90.0)
    ]
    assert rows[0]["value"] == rows[0]["r_env"] and list(rows[0])[:2] == ["asked", "value"]
    assert rows[1]["value"] == pytest.approx(rows[1]["r_social"])
    assert "policy" not in rows[0] and rows[0]["episodes"] == 3


def test_oracle_lookahead_is_never_worse_in_the_mean_and_counts_as_greedy(trained, tmp_path):
    plain = Driving(driver="last.safetensors", episodes=8)
    ahead = Driving(driver="last.safetensors", episodes=8, angles=(0.0,), ahead="lookahead")
    jobs = [evaluation(name, run, 1.0) for name, run in (("plain", plain), ("seeing", ahead))]
    for job in jobs:
        drive(job.config, tmp_path / job.name, {"trained": trained}, lambda _share: None)
    episodes = evaluated(jobs, tmp_path)
    assert list(episodes) == [("plain", "greedy"), ("seeing", "greedy")]
    means = [float(np.mean(played.totals.env)) for played in episodes.values()]
    assert means[1] >= means[0]


def test_a_calibrated_dial_answers_with_its_own_policies(tmp_path):
    folder = tmp_path / "dial"
    folder.mkdir()
    dial = DialPolicy.load(DIAL)
    dial.save(folder / "dial.safetensors")
    config = Driving(angles=(0.0, 45.0, 90.0), episodes=4, first_seed=15_000_000)
    calibrate_dial(config, tmp_path, {"dials/0": folder}, lambda _share: None)
    told = DialPolicy.load(tmp_path / "dial.safetensors")
    assert not dial.settings and told.settings
    assert {told.setting(angle) for angle in config.angles} <= set(config.angles)
