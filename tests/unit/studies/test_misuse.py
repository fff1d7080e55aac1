"""The study `misuse`: switching policies, and the rows of joint verdicts."""

import numpy as np

from socialiq.evaluation.simulate import Watched
from socialiq.nn.q_policy import QPolicy
from socialiq.worlds.intersection.options import FASTER, SLOWER
from socialiq.worlds.registry import make
from studies.misuse.study import across_rows, crowded, in_share


def test_a_switching_policy_drives_otherwise_where_more_vehicles_are_in_view():
    world = make("intersection")
    seen = np.zeros((3, 71), np.float32)
    for row, vehicles in enumerate((0, 3, 4)):
        seen[row, :70].reshape(10, 7)[: vehicles + 1, 0] = 1.0  # with the ego
    brakes = QPolicy((np.zeros((3, 71)),), (np.array([1.0, 0.0, 0.0]),), "relu", 1.0)
    actions, _ = Watched(brakes, crowded(3), world.driver("go")).predict(seen)
    assert actions.tolist() == [SLOWER, SLOWER, FASTER]


def test_the_drawn_share_is_as_large_as_named():
    observation = np.random.default_rng(1).normal(size=(4000, 71)).astype(np.float32)
    assert abs(in_share(0.1)(observation).mean() - 0.1) < 0.02
    np.testing.assert_array_equal(in_share(0.1)(observation), in_share(0.1)(observation))


def test_a_joint_pass_needs_a_pass_in_each_scenario():
    columns = ("extra", "extra_low", "extra_high", "delay", "braking", "gap_below_1_s")
    audits = [
        {"policy": name, "scenario": scenario, "verdict": verdict} | dict.fromkeys(columns, extra)
        for name, scenario, verdict, extra in (
            ("honest", "quiet", "pass", 0.0), ("honest", "dense", "pass", 0.0),
            ("other", "quiet", "pass", 1.0), ("other", "dense", "fail", 30.0),
            ("third", "quiet", "pass", 1.0), ("third", "dense", "inconclusive", 0.5),
        )
    ]  # fmt: skip
    rows = list(across_rows(audits, ["quiet", "dense"]))
    assert [row["across"] for row in rows] == ["pass", "fail", "inconclusive"]
    assert (rows[1]["worst_in"], rows[1]["extra"]) == ("dense", 30.0)
