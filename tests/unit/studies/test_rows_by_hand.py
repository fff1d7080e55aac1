"""Rows, summaries and plans of the studies, from a few rows by hand."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from socialiq import UserError
from socialiq.evaluation.measures import Episodes
from socialiq.evaluation.rollout import MODES
from socialiq.results_folder import Results
from socialiq.types import Ending
from socialiq_lab.declared import State
from socialiq_lab.intersection import thesis_tables
from socialiq_lab.registry import find
from socialiq_lab.tables import options_name
from studies.audit_power import power
from studies.audits import study as audits
from studies.grid import study as grid
from studies.intersection import plan as intersection
from studies.intersection import study as intersection_study
from studies.intersection_continuous import study as continuous
from studies.intersection_offline import study as offline
from studies.intersection_world import study as world
from studies.lambda_sweep.study import settled
from studies.mujoco_imitation import study as imitation
from studies.poc import study as poc
from studies.recorded_junction_practice import work as junction


@pytest.mark.parametrize(
    ("near", "update"),
    [
        ([True, True, True], 10),
        ([False, True, True], 20),
        ([True, False, True], 30),
        ([True, True, False], ""),
        ([False, False, False], ""),
    ],
)
def test_a_run_has_settled_from_where_it_stays_near(near, update):
    assert settled([10, 20, 30], near) == update


def test_changed_options_name_a_variant():
    assert options_name({}) == "default"
    assert options_name({"zone": "last_8_m", "crash": "add"}) == "zone=last_8_m, crash=add"
    names = [options_name(variant) for variant in world._DRIVEN["readings"]]
    assert len(set(names)) == len(names) and names[0] == "default"


# The 7x7 study: states are (ego y, speed, vehicle 1 y, ..., vehicle 2 y).
STATES = np.array([[2, 0, 1, 0, 0], [2, 0, 1, 0, 5], [2, 0, 4, 0, 5], [1, 0, 1, 0, 0]])
STOPS = np.array([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0], [1.0, 0.0]])


@pytest.fixture
def visited(monkeypatch):
    """Four states, of which a policy visits the first twice, the second once, the third never."""
    rows = [("baseline", STOPS, np.array([2.0, 1.0, 0.0, 7.0]))]
    monkeypatch.setattr(grid, "_visited", lambda _state: iter(rows))
    return State(None, SimpleNamespace(part=SimpleNamespace(states=STATES)))


def test_a_heat_map_is_weighted_by_visits_and_empty_without_any(visited):
    rows = {(row["y_1"], row["y_2"]): row for row in grid.heatmap_rows(visited)}
    assert rows.keys() == {(1, 0), (1, 5), (4, 5)}  # of the cell before the conflict alone
    assert rows[1, 0]["weighted"] == rows[1, 0]["unweighted"] == 1.0
    assert rows[1, 5]["visits"] == 1.0 and rows[1, 5]["weighted"] == 0.5
    assert rows[4, 5]["weighted"] == "" and rows[4, 5]["unweighted"] == 0.0


def test_stops_are_counted_by_the_nearest_vehicle_that_approaches(visited):
    rows = {row["distance"]: row for row in grid.distance_rows(visited)}
    assert list(rows) == [1, 2, 3, "none approaching"]
    # Vehicles at y = 1 are two cells before the conflict at y = 3; those at 4 and 5 have passed.
    assert rows[2]["visits"] == 3.0 and rows[2]["stops"] == pytest.approx((2 * 1 + 1 * 0.5) / 3)
    assert rows[1]["stops"] == rows[3]["stops"] == rows["none approaching"]["stops"] == ""


def pooled_row(method, kind, strength, angle, readout="greedy", mixture="equal_trajectories"):
    label = {"method": method, "mixture": mixture, "target_kind": kind, "strength": strength}
    return label | {"target_angle": angle, "readout": readout, "angle": angle + 1, "regret": 0.5}


def test_the_summary_has_the_policies_of_the_figures_alone():
    config = SimpleNamespace(target_kinds=("running", "to_go"), strengths=(2.0, 1.0))
    rows = [pooled_row("baseline", "none", 0.0, angle) for angle in MODES.values()]
    rows += [
        pooled_row("reward_regularized", kind, strength, 45.0)
        for kind, strength in itertools.product(config.target_kinds, config.strengths)
    ]
    rows.append(pooled_row("baseline", "none", 0.0, 0.0, mixture="equal_transitions"))
    state = State(config, None, {"pooled": rows, "experts": [{"mode": "egoistic", "angle": 1.0}]})
    summary = grid.summary(state)
    assert summary["policies"].keys() == {"baseline_greedy", "prosocial_greedy"}
    assert summary["policies"]["prosocial_greedy"] == {"angle": 46.0, "regret": 0.5}
    baseline = summary["policies"]["baseline_greedy"]
    assert [baseline[f"regret_at_{angle:g}"] for angle in MODES.values()] == [0.5] * 3
    assert summary["experts"]["egoistic"]["angle"] == 1.0


def test_the_ring_has_a_mark_for_each_policy_and_the_thesis_outside():
    entry = {"angle": 40.0, "seeds": 10, "regret": 0.1, "arrival": 1.0, "timeout": 0.0}
    policies = {f"{name}_greedy": entry for name in grid.THESIS_ANGLES}
    results = Results("grid", {}, {}, {"policies": policies, "experts": {}}, {})
    (axes,) = grid.ring_figure(results)["fig_6_2_ring"].axes
    labels = axes.get_legend_handles_labels()[1]
    assert "baseline: 40.0° (thesis 152°)" in labels and len(labels) == 4
    assert "10 seeds" in axes.get_title()
    (view,) = grid.view(results)
    assert [row["policy"] for row in view.rows] == ["baseline", *MODES]


def test_the_small_world_draws_the_commonest_sequence_beside_the_thesis():
    entry = {"commonest": "WG" * 6, "commonest_seeds": 7, "seeds": 10, "thesis": "WWWWGGGG"}
    results = Results("poc", {}, {}, {"policies": {"baseline": entry}}, {})
    (axes,) = poc.pictures(results)["fig_6_1"].axes
    texts = [text.get_text() for text in axes.texts]
    assert {"7 of 10 seeds", "thesis: WWWWGGGG", "baseline"} <= set(texts)
    assert texts.count("W") == texts.count("G") == 4 and "…" in texts  # eight letters, then more


def audit(policy, declared, made_for, verdict, direction="pass", where="intersection"):
    row = {"world": where, "policy": policy, "declared": declared, "made_for": made_for}
    row |= {"truthful": int(made_for == declared), "verdict": verdict}
    return row | {"direction": direction}


def test_verdicts_are_counted_by_whether_the_declaration_is_true():
    rows = [
        audit("expert", 0.0, 0.0, "pass"),
        audit("expert", 45.0, 0.0, "fail", "inconclusive"),
        audit("learner", 45.0, 45.0, "inconclusive"),
        audit("never moves", 90.0, "", "fail"),
        audit("dial", 30.0, 30.0, "pass", where="crossing7"),
    ]
    floor = [
        {"policy": policy, "criterion": name, "of_seeds": seeds, "of_episodes": "pass"}
        for policy, name, seeds in (
            ("egoistic", "arrival", "fail"),
            ("egoistic", "timeout", "fail"),
            ("altruistic", "arrival", "pass"),
        )
    ]
    tables = {"audits": rows, "published_floor": floor}
    tables |= {"published_returns": [], "published_angles": []}
    summary = audits._summary(tables)
    assert summary["counts"] == {
        "truthful": {"audits": 3, "pass": 2, "fail": 0, "inconclusive": 1},
        "false": {"audits": 1, "pass": 0, "fail": 1, "inconclusive": 0},
    }
    assert summary["angle_test"]["false"]["inconclusive"] == 1
    # A policy fails if any of its criteria does.
    assert summary["published"]["floor_failing"] == {"of_seeds": 1, "of_episodes": 0}
    assert summary["published"]["policies"] == 2


@pytest.mark.parametrize("regret", [0.0, 0.25, 1.0])
def test_a_made_up_policy_has_its_regret_towards_the_best_reference(regret):
    truth = power.Truth(regret=regret)
    direction = np.array([np.cos(np.pi / 4), np.sin(np.pi / 4)])
    values = truth.references @ direction
    assert values.max() - truth.policy @ direction == pytest.approx(regret)
    env, social = truth.policy
    assert np.degrees(np.arctan2(social, env)) == pytest.approx(truth.alpha_hat)
    total = truth.at_fault + truth.struck + truth.arrival + truth.timeout
    assert total == pytest.approx(1.0)


def test_shares_have_the_interval_of_wilson():
    row = power.shares(100, passed=50, failed=0)
    assert row["passed"] == 0.5 and row["passed_low"] == pytest.approx(1 - row["passed_high"])
    assert row["failed"] == 0.0 == row["failed_low"] and row["failed_high"] > 0.05
    covered = power.share("covered", 50, 100)
    assert list(covered) == ["covered", "low", "high"]
    assert (covered["low"], covered["high"]) == (row["passed_low"], row["passed_high"])


def episodes_with(endings):
    """Episodes of these endings, otherwise of the same columns."""
    count = len(endings)
    columns = {"ending": np.array(endings), "length": np.ones(count, int)}
    for name in ("contact", "neighbours_collided"):
        columns[name] = np.zeros(count, int)
    return Episodes(columns, speed=np.zeros(count), stopped=np.zeros(count))


def test_the_spread_over_groups_of_episodes_is_that_of_their_shares():
    arrival, timeout = int(Ending.ARRIVAL), int(Ending.TIMEOUT)
    groups = [arrival, arrival], [arrival, timeout], [timeout, timeout]
    episodes = episodes_with([*itertools.chain(*groups), arrival])  # the last is in no group
    config = SimpleNamespace(group_episodes=2, evaluation_seeds=3)
    spread = thesis_tables.group_spread(episodes, config, "arrival")
    assert spread == pytest.approx(np.std([1.0, 0.5, 0.0], ddof=1))
    assert thesis_tables.group_spread(episodes, config, "collision") == 0.0


@pytest.fixture
def plan_config():
    """Settings of the intersection study, one seed more than an ablation."""
    config = find("intersection").Config()
    return dataclasses.replace(config, seeds=(1, 2), ablation_seeds=(1,), highway_episodes=0)


def test_differences_compare_a_learner_with_the_same_expert_for_each_seed(plan_config):
    columns = intersection.columns(plan_config)
    rate = dict.fromkeys(itertools.chain(*columns["experts", "flat"].values()), 0.5)
    for group, policies in columns.items():
        for target, names in policies.items() if group != ("experts", "flat") else ():
            rate |= {name: (0.1 * n + (target == "altruistic")) for n, name in enumerate(names)}
    metrics = {comparison.metric for comparison in thesis_tables.COMPARISONS}
    rows = {(name, "greedy"): dict.fromkeys(metrics, value) for name, value in rate.items()}
    tests = intersection_study.differences(rows, plan_config)
    assert len(tests) == len(intersection.TRAINED) * len(thesis_tables.COMPARISONS)
    by_pair = {(row["first"], row["second"]): row["mean"] for row in tests}
    assert by_pair["egoistic", "expert egoistic"] == pytest.approx(0.05 - 0.5)
    assert by_pair["altruistic", "prosocial"] == pytest.approx(1.0)
    assert all(row["p_holm"] >= row["p"] for row in tests)
    prosocial = columns["calibrated", "online"]["prosocial"][0]
    empty = rows | {(prosocial, "greedy"): dict.fromkeys(metrics, "")}
    fewer = intersection_study.differences(empty, plan_config)
    assert 0 < len(fewer) < len(tests)
    calibrated = [r for r in fewer if (r["preset"], r["setting"]) == ("calibrated", "online")]
    assert calibrated
    assert not [r for r in calibrated if "prosocial" in (r["first"], r["second"])]


def test_a_part_alone_has_its_jobs_beside_the_main_ones(plan_config):
    def names(*parts):
        config = dataclasses.replace(plan_config, parts=parts)
        return {job.name for job in intersection.jobs(config)}

    main = names("main")
    assert len([name for name in main if name.startswith("learners/")]) == 3 * 4 * 2
    views = names("main", "views") - main
    assert len(views) == 2 * 8  # each is trained and driven
    targets = [name for name in names("targets") - main if not name.startswith("evaluation")]
    # Without a prior the kind of target means nothing: there are no baselines of other kinds.
    baselines = [name for name in targets if "/baseline/" in name]
    assert len(baselines) == 4 * 2
    data = [name for name in names("data") - main if name.startswith("data/")]
    assert len(data) == 5 * 4


def test_the_atlas_is_made_of_experts_and_the_first_seed(plan_config):
    members = intersection.members(plan_config)
    assert list(members) == [*(f"expert_{mode}" for mode in MODES), "baseline", *MODES]
    assert members["prosocial"] == "learners/calibrated/online/prosocial/1"
    assert intersection.policy_file(members["prosocial"]) == intersection.LAST
    assert intersection.policy_file(members["expert_egoistic"]) == intersection.BEST


METRICS = dict.fromkeys(continuous.METRICS, 0.5)


def test_the_main_table_of_continuous_actions_has_mean_and_spread_over_seeds():
    policies = [
        METRICS | {"name": "expert egoistic", "speed_kmh": 30.0},
        *(METRICS | {"name": "egoistic", "speed_kmh": speed} for speed in (20.0, 24.0)),
    ]
    dials = [
        METRICS | {"kind": continuous.DISCRETE, "asked": angle, "speed_kmh": 10.0}
        for angle in (0.0, 15.0)
    ]
    rows = {(r["policy"], r["metric"]): r for r in continuous.main_table(policies, dials)}
    assert {policy for policy, _ in rows} == {
        "expert egoistic",
        "egoistic",
        "discrete dial egoistic",
    }
    speed = rows["egoistic", "speed_kmh"]
    assert (speed["mean"], speed["low"], speed["high"], speed["seeds"]) == (22.0, 20.0, 24.0, 2)
    assert speed["sd"] == pytest.approx(8**0.5)
    assert rows["expert egoistic", "speed_kmh"]["sd"] == ""  # one seed
    assert rows["egoistic", "collision"]["mean"] == 50.0  # percent


def test_every_program_of_continuous_actions_is_driven_and_learners_have_mixtures():
    config = find("intersection-continuous").Config(
        seeds=(1,), learner_seeds=(2, 3), angles=(0.0, 90.0)
    )
    jobs = {job.name: job for job in continuous.jobs(config)}
    trained = [*continuous.POLICIES, *continuous.KINDS]
    assert all(f"evaluation/{name}" in jobs for name in trained)
    experts = jobs[continuous.EXPERTS].config.numbers
    assert [(run.angle, run.seed) for run in experts] == [(0.0, 78), (45.0, 78), (90.0, 78)]
    baseline = jobs["learners/baseline"].config
    assert [(run.angle, run.seed) for run in baseline.numbers] == [(0.0, 2), (0.0, 3)]
    assert baseline.structure.prior == "none"
    assert jobs["offline/weighted-cloning"].config.structure.weighted
    assert not jobs["offline/cloning"].config.structure.weighted
    assert jobs[continuous.DISCRETE].config.structure.demonstrations is False
    dial = jobs[f"evaluation/{continuous.CONTINUOUS}"].config
    assert dial.angles == (0.0, 90.0) and dial.first_seed == config.first_episode
    with pytest.raises(UserError, match="learner_seeds must name at least one"):
        find("intersection-continuous").Config(learner_seeds=())


OFFLINE = find("intersection-offline").Config(
    seeds=(1, 2, 3), angles=(0.0, 45.0), method_angles=(0.0,), together=2
)


def test_each_method_of_offline_learning_says_how_it_is_trained():
    def structure(method):
        return offline.runs_of(OFFLINE, method, (1, 2)).structure

    assert structure("clone weighted by advantage").weighted_by == "advantage_fitted"
    assert structure("clone weighted by R(α)").weighted
    assert not structure("clone of all").weighted
    assert offline.runs_of(OFFLINE, "clone of the mode", (1,)).nearest
    assert structure("IQ-Learn, dueling").form == "dueling" != structure("IQ-Learn").form
    assert structure("IQ-Learn online").online and not structure("IQ-Learn").online
    reweighted = structure("IQ-Learn, dueling, reweighted")
    assert (reweighted.prior, reweighted.target_kind) == ("reweighting", "trajectory")
    assert structure("IQ-Learn online, shifted χ²").prior == "shifted_chi2"
    dial = offline.runs_of(OFFLINE, offline.OWN, (1, 2))
    assert dial.angles == () and dial.structure == OFFLINE.structure
    assert offline.runs_of(OFFLINE, "clone of all", (1,)).angles == (0.0,)


def test_folders_of_offline_learning_are_of_programs_and_plain_letters():
    assert offline.folder_of(OFFLINE, offline.OWN, 2) == "dials/1"
    assert offline.folder_of(OFFLINE, offline.OWN, 3) == "dials/3"
    name = offline.folder_of(OFFLINE, "IQ-Learn online, shifted χ²", 1)
    assert name == "learners/IQ-Learn-online-shifted-chi2/1"
    name = offline.folder_of(OFFLINE, "clone weighted by R(α)", 1)
    assert name == "learners/clone-weighted-by-total/1"


def test_what_beats_the_best_demonstrator_is_summarised_by_angle():
    def test(mean, p, **label):
        return label | {"mean": mean, "p": p, "p_holm": 2 * p}

    tables = {
        "differences": [
            test(1.0, 0.001, asked=0.0, other="demonstrator egoistic"),
            test(-1.0, 0.03, asked=45.0, other="demonstrator prosocial"),
            test(1.0, 0.001, asked=0.0, other="IQ-Learn"),
        ],
        "forms": [test(1.0, 0.04, asked=90.0, form="IQ-Learn", other="clone weighted by R(α)")],
    }
    assert offline.summarised(tables) == {
        "against_best_demonstrator": {"0": "above", "45": "below"},
        "iq_learn_against_clones": {"IQ-Learn": {"clone weighted by R(α)": {"90": "level"}}},
    }


def test_shares_of_an_expert_are_pooled_and_empty_without_runs():
    runs = [{"mean_return": value, "share": value / 200} for value in (100.0, 180.0)]
    assert imitation._pooled(runs) == {
        "mean_return": 140.0,
        "least_run": 100.0,
        "share": pytest.approx(0.7),
        "least_share": 0.5,
    }
    assert set(imitation._pooled([]).values()) == {""}
    returns = imitation._of_returns([1.0, 3.0, 8.0])
    assert returns == {"mean_return": 4.0, "least_return": 1.0, "greatest_return": 8.0}


def test_a_pair_of_methods_is_compared_over_the_seeds_of_both():
    cell = [
        {"method": method, "seed": seed, "share": share}
        for method, shares in (("online", {0: 0.9, 1: 0.7, 2: 0.8}), ("cloning", {1: 0.5, 2: 0.2}))
        for seed, share in shares.items()
    ]
    (row,) = imitation._paired({"task": "Hopper"}, cell, "online", "cloning")
    assert row["mean"] == pytest.approx((0.2 + 0.6) / 2) and row["task"] == "Hopper"
    assert imitation._paired({}, cell[:4], "online", "cloning") == []  # one seed of both


def test_jobs_of_the_recorded_junction_practise_in_one_mixture_alone(tmp_path):
    (tmp_path / "USA_Lanker-1.xml").write_text("<a/>")
    config = find("recorded-junction-practice").Config(
        recordings=str(tmp_path), seeds=(1, 2), episodes=10
    )
    jobs = {job.name: job for job in junction.jobs(config)}
    names = ["recorded", "recorded-with-practice"]
    assert [name for name in jobs if name.startswith("dials/")] == [f"dials/{n}" for n in names]
    rounds = [jobs[f"dials/{name}"].config.practice.rounds for name in names]
    assert rounds == [0, config.practice.rounds]
    assert jobs["driven/recorded"].inputs == ("world", "dials/recorded")
    assert jobs["drivers"].config.seeds == () and jobs["drivers"].inputs == ("world",)
    (content,) = jobs["world"].config.contents.values()
    assert len(content) == 64
