"""Studies of the gridworlds: exact facts, sequences, adaptation and penalties, by hand."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.evaluation.exact import Ground
from socialiq.evaluation.rollout import MODES
from socialiq.results_folder import Results
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq_lab.declared import State
from socialiq_lab.study import silent
from socialiq_lab.tables import derived
from studies.dial import study as dial
from studies.grid import study as grid
from studies.lambda_sweep import study as sweep
from studies.penalties import study as penalties
from studies.poc import study as poc
from studies.worlds import study as worlds


@pytest.fixture(scope="module")
def table5():
    return tabulate(make_grid("crossing5"))


def test_the_experts_of_the_small_world_are_the_thesis():
    row = worlds._crossing5_row({})
    assert row == {"reading": "default"} | {mode: poc.THESIS[mode] for mode in MODES}
    assert worlds._crossing5_row({"social_cost": "always"})["reading"] == "social_cost=always"


def test_ties_are_broken_either_way_and_an_exact_cosine_leaves_more_of_them():
    rows = worlds._tie_rows()
    assert [(row["trigonometry"], row["ties_to"]) for row in rows] == [
        ("cos 90 = 6e-17", "Wait"),
        ("cos 90 = 6e-17", "Go"),
        ("cos 90 = 0", "Wait"),
        ("cos 90 = 0", "Go"),
    ]
    assert all(set(row[mode]) <= set("WG") for row in rows for mode in MODES)
    assert rows[0]["egoistic"] == rows[3]["egoistic"] == "GGGG"  # no tie at 0 degrees
    assert len(rows[2]["altruistic"]) >= len(rows[3]["altruistic"])


def test_a_clock_can_only_help_and_the_radius_bounds_the_optimum(table5):
    rows = worlds._front_rows(table5)
    assert [row["angle"] for row in rows[:3]] == [0.0, 5.0, 10.0]
    for row in rows:
        assert row["stationary_value"] <= row["value"] + 1e-9
        radians = np.deg2rad(row["angle"])
        value = np.cos(radians) * row["r_env"] + np.sin(radians) * row["r_social"]
        assert row["value"] == pytest.approx(value) and row["radius"] <= row["value"] + 1e-9


def test_a_world_is_summarised_by_its_sizes(table5):
    found = worlds._world_summary(table5)
    assert found["states"] == table5.mdp.n_states >= found["reachable_states"]
    assert (found["actions"], found["horizon"]) == (2, table5.world.horizon)
    assert set(found["weights"]) == {*table5.world.env_weights, *table5.world.social_weights}


def sequences(*letters, **more):
    return [
        {"target_kind": "none", "next_value": "online", "policy": "baseline", "thesis": "WG"}
        | {"seed": seed, "sequence": text, "equal": int(text == "WG"), "equal_at": at}
        | more
        for seed, (text, at) in enumerate(letters)
    ]


def test_agreement_counts_seeds_and_names_the_commonest():
    rows = sequences(("WG", "1000 2000"), ("GG", "1000"), ("GG", ""))
    (row,) = poc._agreement(rows)
    assert (row["seeds"], row["equal"]) == (3, 1)
    assert (row["commonest"], row["commonest_seeds"], row["thesis"]) == ("GG", 2, "WG")
    (by,) = poc._by_updates(rows, 2500)
    assert [by[f"at_{n}"] for n in (1000, 2000, 2500)] == [2, 1, 0]


@pytest.mark.parametrize(("kind", "modes"), [("none", ["baseline"]), ("running", [*MODES])])
def test_a_tiny_training_has_a_row_for_each_run(kind, modes):
    ground = Ground.of("crossing5")
    from socialiq.evaluation.rollout import demonstrations_by_mode
    from socialiq.learners.iq_learn import config as presets

    data = demonstrations_by_mode(ground.table, dict.fromkeys(MODES, 1), 0)
    merged = poc.equal_trajectories(data, 1, 0)
    static = poc.dataclasses.replace(presets.POC, updates=4, hidden=(8,))
    config = SimpleNamespace(seeds=(0, 1), strength=1.0)
    rows = poc._train(ground, static, kind, config, merged, silent)
    assert [(row["policy"], row["seed"]) for row in rows] == [(m, s) for m in modes for s in (0, 1)]
    for row in rows:
        assert row["target_kind"] == kind and row["thesis"] == poc.THESIS[row["policy"]]
        assert row["equal"] == (row["sequence"] == row["thesis"]) == bool(row["equal_at"])


def ground_with_optimum(env, social):
    best = SimpleNamespace(point=SimpleNamespace(env=env, social=social))
    optimum = SimpleNamespace(attainable=SimpleNamespace(optimum=lambda _angle: best))
    return SimpleNamespace(optimum=optimum)


def test_a_run_adapts_where_its_angle_stays_near_the_optimums():
    state = State(SimpleNamespace(seeds=(0,)), ground_with_optimum(1.0, 0.0))
    key = {"target_kind": "running", "strength": 1.0, "readout": "greedy", "seed": 0}
    angles = ((10, 150.0), (20, 15.0), (30, 60.0), (40, -19.0))
    state.tables["checkpoints"] = [key | {"updates": n, "angle": a} for n, a in angles]
    (row,) = sweep.adaptation_rows(state)
    assert (row["first_update_within"], row["settled_update"], row["within_at_end"]) == (20, 40, 1)
    state.tables["adaptation"] = [row]
    pooled = {"target_kind": "running", "strength": 1.0, "readout": "greedy", "regret": 0.5}
    state.tables["pooled"] = [pooled]
    entry = sweep.summary(state)["readings"]["running"]["greedy"]["1"]
    assert entry == {
        "regret": 0.5,
        "adapted_at_end": 1,
        "adapted_ever": 1,
        "mean_first_update": 20.0,
        "mean_settled_update": 40.0,
    }


def test_penalties_are_zero_at_the_target_alone():
    target, other = jnp.array([1.0, -1.0, 0.5]), jnp.array([0.0, 0.0, 0.0])
    assert float(penalties.l1(2.0 * target, target, jnp.float32(2.0))) == 0.0
    assert float(penalties.l1(other, target, jnp.float32(1.0))) == pytest.approx(2.5 / 3)
    assert float(penalties.kl(2.0 * target, target, jnp.float32(2.0))) == pytest.approx(0, abs=1e-6)
    assert float(penalties.kl(2.0 * target + 7.0, target, jnp.float32(2.0))) == pytest.approx(
        0, abs=1e-5
    )  # a softmax doesn't see a constant
    assert float(penalties.kl(other, target, jnp.float32(2.0))) > 0.1


def test_deviations_are_matched_within_a_share_of_the_largest_target():
    target = np.array([10.0, -10.0, 0.0, 1.0])
    row = penalties._deviation_row(np.array([0.4, -0.4, 0.6, 0.0]), target)
    assert row["matched"] == 0.75  # 0.6 exceeds 5 % of 10
    assert (row["median"], row["largest"]) == (pytest.approx(0.4), 0.6)
    assert row["peakedness"] == pytest.approx(1.5) and row["level"] == pytest.approx(0.15)
    assert penalties._deviation_row(np.full(4, 3.0), target)["correlation"] == pytest.approx(1.0)


@pytest.fixture(scope="module")
def state7():
    ground = Ground.of("crossing7")
    config = SimpleNamespace(target_kinds=("running",), strengths=(2.0,), seeds=(0,))
    return State(config, ground)


def test_experts_have_no_regret_but_that_of_a_missing_clock(state7):
    rows = grid.expert_rows(state7)
    assert [row["mode"] for row in rows] == [*MODES]
    for row in rows:
        assert -1e-9 <= row["regret"] < 0.5
        radians = np.deg2rad(row["target_angle"])
        value = np.cos(radians) * row["r_env"] + np.sin(radians) * row["r_social"]
        assert row["optimum_value"] - row["regret"] == pytest.approx(value)


def test_optima_turn_from_own_progress_to_the_effect_on_others(state7):
    rows = grid.attainable_rows(state7)
    env, social = ([row[f"optimum_r_{name}"] for row in rows] for name in ("env", "social"))
    assert (np.diff(env) <= 1e-9).all() and (np.diff(social) >= -1e-9).all()
    assert len(rows) == 19 and rows[-1]["angle"] == 90


def test_data_rows_are_shares_of_each_data_set():
    data = SimpleNamespace(n_transitions=10, counts=lambda: {"a": (2, 4), "b": (2, 6)})
    rows = grid.data_rows(State(None, None, data={"trajectories 2": [data]}))
    assert [row["share_of_transitions"] for row in rows] == [0.4, 0.6]
    assert rows[0]["mixture"] == "equal_trajectories" and rows[1]["mode"] == "b"


def test_the_comparison_has_the_thesis_angles_beside_ours():
    entry = {"angle": 40.0, "regret": 0.1, "arrival": 1.0, "timeout": 0.0}
    policies = {f"{name}_greedy": entry for name in grid.THESIS_ANGLES}
    experts = {mode: {"angle": 10.0} for mode in MODES}
    results = Results("grid", {}, {}, {"policies": policies, "experts": experts}, {})
    baseline, *targets = grid.comparison(results)
    assert (baseline["target"], baseline["regret"], baseline["optimum"]) == ("none", "", "")
    assert [row["target"] for row in targets] == ["0", "45", "90"]
    assert targets[1]["thesis"] == 39.0 and targets[1]["optimum"] == 10.0


def test_a_mixture_out_of_reach_is_none():
    points = np.array([[1.0, 0.0], [0.0, 1.0]])
    found = dial._reached(points, 45.0)
    assert found is not None and found.share == pytest.approx(0.5)
    assert dial._reached(points, 180.0) is None


def test_dials_are_pooled_over_seeds_and_empty_columns_stay_empty():
    dials = [
        {"run": "offline", "seed": seed, "readout": "soft", "regret": regret, "error": error}
        for seed, regret, error in ((0, 1.0, ""), (1, 3.0, ""))
    ]
    (row,) = derived({"from": "dials", "spread": ["run", "readout"]}, {"dials": dials}, None)
    assert (row["seeds"], row["regret_mean"], row["regret_low"], row["regret_high"]) == (2, 2, 1, 3)
    assert row["error_mean"] == row["error_high"] == ""
