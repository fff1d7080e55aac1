"""The study of continuous actions end to end at a tiny size, and its tables of known rows."""

import dataclasses
from typing import Any

import pytest
from tests.digest.studies import differs

from socialiq import results_folder as store
from socialiq.errors import UserError
from socialiq.evaluation.rollout import MODES
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.plotting.style import png
from socialiq.settings import changed
from socialiq_lab.intersection.thesis_values import METRICS, POLICIES
from socialiq_lab.registry import study_and_declaration
from socialiq_lab.tables import matching
from studies.intersection_continuous.study import CONTINUOUS, DISCRETE, KINDS, main_table

STUDY, CONTENT = study_and_declaration("intersection-continuous")
PLAIN = STUDY.Config()
TINY = changed(PLAIN, CONTENT["tiny"])


def test_both_dials_have_one_budget():
    ours, theirs = PLAIN.continuous, PLAIN.discrete
    assert (ours.updates, ours.hidden, ours.view) == (theirs.updates, theirs.hidden, theirs.view)
    assert (ours.batch_size, ours.replay_capacity) == (theirs.replay_batch, theirs.replay_capacity)
    assert (ours.low, ours.high, ours.high_share) == (theirs.low, theirs.high, theirs.high_share)
    assert PLAIN.high_angles == dataclasses.replace(ours, high_share=0.8)
    assert PLAIN.options.destination == PLAIN.discrete_options.destination
    with pytest.raises(UserError, match="seeds must name at least one"):
        STUDY.Config(seeds=())


def test_the_main_table_has_means_over_seeds_in_percent():
    row: dict[str, Any] = dict.fromkeys(METRICS, 0.5)
    experts = [{"name": "expert egoistic", "seed": 1, **row, "collision": 0.1}]
    learners = [{"name": "egoistic", "seed": n, **row, "collision": n / 10} for n in (2, 4)]
    dials = [{"kind": CONTINUOUS, "asked": a, "seed": 1, **row} for a in (0.0, 15.0)]
    found = {(one["policy"], one["metric"]): one for one in main_table(experts + learners, dials)}
    assert found["expert egoistic", "collision"]["mean"] == pytest.approx(10.0)
    assert found["expert egoistic", "collision"]["sd"] == ""
    learner = found["egoistic", "collision"]
    assert (learner["mean"], learner["low"], learner["high"]) == pytest.approx((30.0, 20.0, 40.0))
    assert learner["sd"] == pytest.approx(200**0.5)
    assert found["continuous dial egoistic", "speed_kmh"]["mean"] == 0.5
    assert len(found) == 3 * len(METRICS)


def test_no_table_of_the_digest_differs(results, work):
    assert differs(STUDY.name, results, work) == []


def test_a_tiny_study_has_every_table_and_picture(results, tmp_path):
    tables = results.tables
    policies = {row["policy"] for row in tables["main"]}
    others = ("longer IQ-Learn", "weighted cloning", "TD3+BC")
    offline = {f"{name} {mode}" for name in others for mode in MODES}
    assert {*POLICIES, "cloning"} | offline < policies
    assert len(policies) == len(POLICIES) + 1 + len(offline) + 3 * len(KINDS)
    # A clone and the baseline have no angle: at every one it is the same policy that is scored.
    of_mixture = tables["mixture"]
    assert len(of_mixture) == 6 * len(MODES) * 2
    for method in ("cloning", "baseline"):
        (shown,) = matching(of_mixture, method=method, asked=0.0, seed=2)
        own = matching(tables["policies"], name=method, seed=2)[0]
        assert shown["value"] == own["value"] == own["r_env"]
        (turned,) = matching(of_mixture, method=method, asked=90.0, seed=2)
        assert turned["value"] == pytest.approx(own["r_social"])
    for method in ("IQ-Learn", *others):
        (shown,) = matching(of_mixture, method=method, asked=90.0, seed=3)
        name = f"{'' if method == 'IQ-Learn' else method} altruistic".strip()
        assert shown["value"] == matching(tables["policies"], name=name, seed=3)[0]["value"]
    assert {row["kind"] for row in tables["dials"]} == set(KINDS)
    assert len(tables["dials"]) == 3 * 2 * 3
    assert all(row["regret"] >= 0.0 for row in tables["dials"])
    pairs = {row["kinds"] for row in tables["differences"]}
    assert pairs == {
        "continuous less discrete",
        "high-angles less discrete",
        "high-angles less continuous",
    }
    measures = [
        row["measure"]
        for row in tables["differences"]
        if row["kinds"] == "high-angles less continuous"
    ]
    assert measures == ["value_0", "value_45", "value_90", "mean_value", "hypervolume"]
    one, other = (
        next(row for row in tables["families"] if (row["kind"], row["seed"]) == (kind, 0))
        for kind in (CONTINUOUS, DISCRETE)
    )
    assert one.keys() == other.keys()
    assert set(png(STUDY.figures(results))) == {"tradeoff", "values"}
    assert len(STUDY.view(results)) == 4
    store.save(results, tmp_path / "out", {}, replace=False)
    expert = ActorPolicy.load(tmp_path / "out" / "atlas" / "expert_altruistic.safetensors")
    assert expert.n_features == 71 and expert.action_size == 1
    assert ActorDial.load(tmp_path / "out" / "dial.safetensors").n_features == 71
