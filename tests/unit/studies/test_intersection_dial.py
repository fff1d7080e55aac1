"""The dial in the intersection end to end at a tiny size: jobs, tables, figures."""

import dataclasses

import numpy as np
import pytest
from tests.digest.studies import differs

from socialiq import results_folder as store
from socialiq.errors import UserError
from socialiq.evaluation.road_training import ITERATION
from socialiq.learners.dial.config import INTERSECTION
from socialiq.learners.dial.rows import stratified
from socialiq.nn.dial_policy import DialPolicy
from socialiq.plotting.style import png
from socialiq.social.angle import angle_of, exact_weights
from socialiq_lab.intersection.rows import value_at
from socialiq_lab.registry import find
from socialiq_lab.study import run
from studies.intersection_dial.study import (
    ABLATIONS,
    FAMILIES,
    known_policies,
    recipe_of,
)

STUDY = find("intersection-dial")
Config = STUDY.Config

TINY = Config(
    seeds=(0, 1),
    key_angles=(0.0, 90.0),
    turned=(0.0, 45.0, 90.0),
    structure=dataclasses.replace(
        Config().structure,
        view="flat",
        hidden=(8,),
        updates=30,
        expert_batch=8,
        replay_batch=8,
        replay_capacity=5000,
    ),
    agent_updates=20,
    pool_episodes=12,
    size=60,
    episodes=12,
)


def test_no_table_of_the_digest_differs(results, work):
    assert differs("intersection-dial", results, work) == []


def test_every_policy_is_driven_and_valued_at_its_angle(results):
    rows = results.tables["policies"]
    assert len(rows) == 2 * (3 + 2)
    for row in rows:
        direction = exact_weights(row["asked"])
        value = direction.env * row["r_env"] + direction.social * row["r_social"]
        assert row["value"] == pytest.approx(value, abs=1e-5)
        assert row["episodes"] == TINY.episodes and row["regret"] >= 0.0


def test_at_every_angle_somebody_has_no_regret_or_a_policy_of_another_angle_is_best(results):
    rows = results.tables["policies"]
    for angle in TINY.turned:
        direction = exact_weights(angle)
        values = [direction.env * r["r_env"] + direction.social * r["r_social"] for r in rows]
        mine = [row for row in rows if row["asked"] == angle]
        least = min(row["regret"] for row in mine)
        best = max(row["value"] for row in mine)
        assert least == pytest.approx(max(values) - best, abs=1e-5)


def test_families_have_a_row_for_each_seed_and_are_compared_in_pairs(results):
    families = results.tables["families"]
    assert [(row["family"], row["seed"]) for row in families] == [
        (family, seed) for family in ("dial", "agents") for seed in TINY.seeds
    ]
    for row in families:
        key = [row["regret_0"], row["regret_90"]]
        assert row["mean_regret"] == pytest.approx(np.mean(key), abs=1e-5)
        assert row["worst_regret"] == max(key)
    dial, agents = families[:2], families[2:]
    by_measure = {row["measure"]: row for row in results.tables["differences"]}
    mean = np.mean([a["hypervolume"] - b["hypervolume"] for a, b in zip(dial, agents, strict=True)])
    assert by_measure["hypervolume"]["mean"] == pytest.approx(mean, abs=1e-5)


def test_the_dial_of_a_run_turns_and_an_agent_does_not(results, work):
    dial = DialPolicy.load(work / "dials" / "0" / "dial.safetensors")
    assert (dial.low, dial.high) == (0.0, 90.0)
    agent = DialPolicy.load(work / "agents" / "90" / "0" / "dial.safetensors")
    with pytest.raises(UserError, match="outside"):
        agent.at(0.0)
    assert agent.provenance["structure"]["updates"] == TINY.agent_updates


def test_the_dial_of_the_first_seed_is_kept_with_the_results(results, work):
    kept = (work / "dials" / "0" / "dial.safetensors").read_bytes()
    assert results.files == {"dial.safetensors": kept}


def test_curves_are_of_every_run(results):
    runs = {row["run"] for row in results.tables["curves"]}
    assert runs == {"dials/0", "dials/1"} | {f"agents/{a}/{s}" for a in (0, 90) for s in (0, 1)}


def test_results_are_saved_and_drawn_from_the_files(results, tmp_path):
    store.save(results, tmp_path / "out", {}, replace=False)
    read = store.load(tmp_path / "out")
    assert read.summary == results.summary
    drawn = png(STUDY.figures(read))
    assert list(drawn) == ["tradeoff", "regret", "turning", "learning"]


def test_environments_divide_the_range_among_them():
    rng = np.random.default_rng(0)
    structure = dataclasses.replace(Config().structure, margin=0.0)
    directions = stratified(structure, 9, rng)
    angles = [angle_of(float(x), float(y)) for x, y in zip(*directions, strict=True)]
    assert [int(angle // 10) for angle in angles] == list(range(9))
    alone = dataclasses.replace(structure, low=30.0, high=30.0)
    fixed = stratified(alone, 4, rng)
    np.testing.assert_allclose(fixed.env, np.cos(np.pi / 6), rtol=1e-6)


def test_a_key_angle_at_which_no_dial_is_driven_is_refused():
    with pytest.raises(UserError, match="key angle"):
        dataclasses.replace(TINY, key_angles=(15.0,))
    with pytest.raises(UserError, match="agent_updates"):
        Config(agent_updates=0)
    with pytest.raises(UserError, match="at least one training seed"):
        Config(seeds=())
    assert Config().numbers.discount < 1.0


TIMED = dataclasses.replace(
    TINY,
    seeds=(3,),
    families=("timed", "calibrated", "iterated", "planned", "foresight", "short", "both_causes"),
    recipe=dataclasses.replace(
        INTERSECTION.structure,
        view="flat",
        hidden=(8,),
        updates=30,
        expert_batch=8,
        replay_batch=8,
        replay_capacity=5000,
        environments=4,
    ),
    iteration=dataclasses.replace(
        ITERATION, batch_size=8, updates=30, states_per_update=1, first_rounds=1
    ),
    ablation_updates=20,
    calibration_episodes=10,
)


@pytest.mark.slow
def test_dials_with_a_clock_are_calibrated_and_ablated(tmp_path):
    found = run(STUDY, TIMED, work=tmp_path / "work")
    rows = found.tables["policies"]
    asked = {
        family: [row["asked"] for row in rows if row["family"] == family] for family in FAMILIES
    }
    assert asked["timed"] == asked["calibrated"] == asked["iterated"] == [0.0, 45.0, 90.0]
    assert (
        asked["short"] == asked["both_causes"] == asked["planned"] == [0.0, 90.0]
        and not asked["agents"]
    )
    seen = found.tables["foresight"]
    assert [row["asked"] for row in seen] == [0.0, 90.0] and not asked["foresight"]
    plain = {row["asked"]: row["value"] for row in rows if row["family"] == "timed"}
    assert all(row["value"] >= plain[row["asked"]] - 1e-6 for row in seen)
    timed, told = (
        DialPolicy.load(tmp_path / "work" / name / "3" / "dial.safetensors")
        for name in ("timed", "calibrated")
    )
    assert timed.pairs and timed.n_features == 71 and not timed.settings and told.settings
    better = DialPolicy.load(tmp_path / "work" / "iterated" / "3" / "dial.safetensors")
    assert better.provenance["start"] == {"sha256": timed.turned.sha256}
    assert better.n_features == 71 and better.pairs
    hidden = DialPolicy.load(tmp_path / "work" / "both_causes" / "3" / "dial.safetensors")
    assert hidden.n_features == 70
    structure = hidden.provenance["structure"]
    assert (structure["high_share"], structure["driven_share"], structure["updates"]) == (
        None,
        0,
        20,
    )
    assert set(found.files) == {f"{one}.safetensors" for one in ("timed", "calibrated", "iterated")}
    assert list(png(STUDY.figures(found))) == ["tradeoff", "regret", "turning", "learning"]


@pytest.mark.parametrize("family", [name for name in FAMILIES if name in ABLATIONS])
def test_every_ablation_changes_what_it_names(family):
    full, one = recipe_of(TIMED, "short"), recipe_of(TIMED, family)
    both = {**vars(one[0]), **vars(one[1])}
    before = {**vars(full[0]), **vars(full[1])}
    declared = {
        name: None if value == "none" else value for name, value in ABLATIONS[family].items()
    }
    assert {name: value for name, value in both.items() if value != before[name]} == declared


def test_the_best_policies_known_are_no_seers():
    rows = known_policies()
    names = {row["policy"] for row in rows}
    assert "atlas/egoistic/as_believed/ahead" in names
    assert not any("foresight" in name or "connected_lanes" in name for name in names)
    assert 9.1 < max(value_at(row, 0.0) for row in rows) < 9.3
    assert 2.3 < max(value_at(row, 90.0) for row in rows) < 2.6


def test_families_that_make_no_study_are_refused():
    with pytest.raises(UserError, match="family"):
        Config(families=("other",))
    with pytest.raises(UserError, match="name both families"):
        Config(families=("calibrated",))
