"""Rows of policies' episodes and of jobs' folders."""

import numpy as np
import pytest

from socialiq.evaluation.episodes import episodes_of, outcome_row, policy_row
from socialiq.storage import write_json
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab.intersection.driving import (
    Driving,
    episodes_at,
    load_episodes,
    save_episodes,
)
from socialiq_lab.intersection.rows import evaluated, times
from socialiq_lab.jobs import RECORD, Job

SEEDS = Driving(episodes=6, first_seed=3).seeds


@pytest.fixture(name="episodes", scope="module")
def driven_episodes():
    return episodes_of(Intersection().batch(6), policy("gap_3s"), SEEDS)


def test_episodes_are_read_as_they_were_written(episodes, tmp_path):
    save_episodes(tmp_path / "greedy.safetensors", episodes)
    again = load_episodes(tmp_path / "greedy.safetensors")
    np.testing.assert_array_equal(again.totals.social, episodes.totals.social)
    assert policy_row("a", "greedy", again) == policy_row("a", "greedy", episodes)


def test_shares_of_a_row_are_of_its_episodes(episodes):
    row = outcome_row(episodes)
    assert row["episodes"] == len(SEEDS) == 6 and SEEDS[0] == 3
    assert row["collision"] + row["arrival"] + row["timeout"] == pytest.approx(1.0)
    assert row["arrival_low"] <= row["arrival"] <= row["arrival_high"]
    assert row["speed_kmh"] == pytest.approx(3.6 * episodes.speed.mean())


def test_every_evaluation_of_the_jobs_has_a_row_for_each_readout(episodes, tmp_path):
    jobs = [
        Job(f"evaluation/{name}", print, Driving(driver="best.safetensors", readouts=readouts))  # type: ignore[arg-type]
        for name, readouts in (("experts/a", ("greedy",)), ("learners/b", ("greedy", "soft")))
    ]
    for number, job in enumerate(jobs, start=1):
        for readout in job.config.readouts:
            save_episodes(episodes_at(tmp_path / job.name, "best.safetensors", readout), episodes)
        write_json(tmp_path / job.name / RECORD, {"seconds": 2.0 * number})
    rows = evaluated(jobs, tmp_path)
    assert list(rows) == [("experts/a", "greedy"), ("learners/b", "greedy"), ("learners/b", "soft")]
    np.testing.assert_array_equal(rows["learners/b", "soft"].totals.env, episodes.totals.env)
    took = {row["jobs"]: row["seconds"] for row in times(jobs, tmp_path)}
    assert took == {"evaluation/experts": 2.0, "evaluation/learners": 4.0}
