"""Statements of the theory on one random world, and how its tables are counted, by hand."""

import dataclasses

import numpy as np
import pytest

from socialiq.theory.objective import shaped
from studies.theory import statements, training
from studies.theory import study as small_strength


@pytest.fixture(scope="module")
def cases():
    """One random world of ten states, with both targets."""
    return statements.random_cases([0])


def test_a_random_world_is_seeded_and_named(cases):
    assert [case.label for case in cases] == [
        {"world": "random 0", "angle": 0.0, "target_kind": kind} for kind in statements.KINDS
    ]
    mdp, again = cases[0].problem.mdp, statements.random_cases([0])[0].problem.mdp
    np.testing.assert_array_equal(mdp.probability, again.probability)
    np.testing.assert_allclose(mdp.probability.sum(axis=2), 1.0)
    assert mdp.initial.sum() == pytest.approx(1.0) and mdp.rewards.env.shape == (10, 3)
    second = statements.random_cases([1])[0].problem.mdp
    assert (mdp.successor != second.successor).any()


@pytest.mark.parametrize(
    ("value", "logarithm"), [(100.0, 2.0), (-0.001, -3.0), (0.0, -17.0), (1e-30, -17.0)]
)
def test_logarithms_are_of_sizes_and_bounded_below(value, logarithm):
    assert statements.log10(value) == pytest.approx(logarithm)


def test_the_minimum_has_the_closed_form_and_no_duality_gap(cases):
    rows = statements.minimum_rows(cases)
    assert len(rows) == 2 * len(statements.STRENGTHS) * len(statements.TEMPERATURES)
    assert [(row["strength"], row["temperature"]) for row in rows[:3]] == [
        (0.0, 1.0),
        (0.0, 0.01),
        (0.3, 1.0),
    ]
    for row in rows:
        assert row["log10_closed_error"] < -6 and row["log10_duality_gap"] < -6
        assert row["largest_correction"] <= row["bound"] + 1e-9


def test_each_demonstrated_pair_has_a_row_with_its_closed_form(cases):
    rows = statements.reward_rows(cases[:1])
    assert len(rows) == cases[0].problem.support.sum()
    for row in rows:
        assert row["solved"] == pytest.approx(row["closed"], abs=1e-6)
        assert cases[0].problem.support[row["state"], row["action"]]


def test_no_other_occupancy_has_a_greater_primal_value(cases):
    rows = statements.primal_rows(cases[:1])
    assert {row["other"] for row in rows} == {"demonstrators", "λ = 0", "3 λ", "opposite target"}
    assert sum(row["gained"] for row in rows) == 0
    demonstrators = [row for row in rows if row["other"] == "demonstrators"]
    lost = [row["log10_lost"] for row in demonstrators]
    assert lost == sorted(lost)  # the loss grows with the share
    assert demonstrators[-1]["share"] == 1.0


def test_shaping_leaves_the_policy_and_another_target_does_not(cases):
    case = cases[0]
    potential = np.random.default_rng(5).normal(size=10)
    target = shaped(case.problem.mdp, case.problem.target, potential, case.problem.discount)
    same = case._replace(problem=dataclasses.replace(case.problem, target=target))
    opposite = dataclasses.replace(case.problem, target=-case.problem.target)
    targets = {"same": [same], "opposite": [case._replace(problem=opposite)]}
    rows = statements.shaping_rows([case], targets)
    by_change = {row["change"]: row["log10_difference"] for row in rows}
    assert [row["change"] for row in rows].count("random shaping") == 5
    assert by_change["same"] < -5 and by_change["random shaping"] < -5
    assert by_change["opposite"] > -2


def test_zero_strength_is_the_baseline_of_a_smaller_chi2(cases):
    (row,) = statements.zero_rows(cases[:1])
    assert row["world"] == "random 0"
    assert row["log10_from_baseline_sixth"] < -5 < row["log10_from_baseline"]
    assert row["log10_from_baseline"] == pytest.approx(np.log10(row["largest_difference"]))


def test_the_objective_is_that_of_conservative_q_learning_but_for_a_constant(cases):
    rows = statements.offline_rows(cases)
    assert len(rows) == 2 * 5
    assert max(row["log10_error"] for row in rows) < -9
    assert len({row["loss"] for row in rows}) == 10  # each at a random Q of its own


def test_the_straight_line_begins_at_the_baseline_and_has_the_slope(cases):
    rows = small_strength.path_rows(cases[:1], (small_strength.COLD,))
    assert len(rows) == 16 and rows[0]["strength"] == 0.0
    assert rows[0]["mean_target"] == pytest.approx(rows[0]["line"], abs=1e-2)
    (slope,) = small_strength.slope_rows(cases[:1])
    assert slope["measured"] == pytest.approx(slope["predicted"], rel=0.05)
    between = (rows[8]["line"] - rows[4]["line"]) / (rows[8]["strength"] - rows[4]["strength"])
    assert between == pytest.approx(slope["predicted"], rel=1e-2)
    assert slope["reach"] == pytest.approx(rows[0]["reach"], rel=1e-6)


def test_flips_are_empty_where_none_is_predicted_or_found(cases):
    rows = small_strength.flip_rows(cases[:1], "online")
    assert rows and {row["next_value"] for row in rows} == {"online"}
    for row in rows:
        assert (row["predicted"] == "") == (row["after"] == "")
        assert (row["found"] == "") == (row["found_after"] == "")
        assert row["before"] != row["after"]
    assert len({row["state"] for row in rows}) == len(rows)


def test_an_advantage_is_an_instantaneous_target_of_shaped_rewards():
    kinds = [training._target_kind(kind) for kind in training.TARGETS]
    assert kinds == ["instantaneous", "to_go", "instantaneous"]


def path(kind, soft, greedy, temperature=1.0):
    label = {"temperature": temperature, "target_kind": kind, "angle": 0.0, "optimum_length": 5.0}
    return [
        label | {"strength": float(number), "soft_length": s, "greedy_length": g}
        for number, (s, g) in enumerate(zip(soft, greedy, strict=True))
    ]


def test_growth_tells_whether_a_length_ever_falls():
    rows = path("to_go", [4.0, 4.5, 6.0], [4, 4, 7]) + path("instantaneous", [4.0, 3.9], [4, 4])
    entries = training.growth(rows)["1"]
    assert entries["to_go"]["0"] == {
        "optimum": 5.0,
        "soft": [4.0, 4.5, 6.0],
        "greedy": [4, 4, 7],
        "soft_grows": True,
        "first": 4.0,
        "last": 6.0,
    }
    assert entries["instantaneous"]["0"]["soft_grows"] is False


def trained_tables(firsts):
    """Tables of one gradient and target: seeds with the λ of their first flip, and below it."""
    key = {"next_value": "online", "target_kind": "to_go"}
    predicted = key | {"norm": 2.0, "occupancy": 0.5, "rows": 1.0, "solved": 2.0, "replay": 1.5}
    runs = [
        key
        | {"seed": seed, "prior_weight": weight, "strength": strength, "mean_go": go}
        | {"soft_length": 4.0 + strength, "greedy_length": 5.0}
        for seed, _ in enumerate(firsts)
        for weight, strength, go in ((0.0, 0.0, 0.5), (1.0, 0.0, 0.4 - seed / 10), (1.0, 1.0, 0.9))
    ]
    flips = [
        key | {"seed": seed, "first": first, "below": below, "zero_leaves": 0}
        for seed, (below, first) in enumerate(firsts)
    ]
    return {"predicted": [predicted], "first_flips": flips, "trained": runs}


def test_trained_flips_are_held_against_each_prediction():
    tables = trained_tables([(1.0, 2.0), (0.5, 1.0), (2.0, 3.0)])
    entry = training.trained_summary(tables)["online"]["to_go"]
    assert (entry["seeds"], entry["left"], entry["least"], entry["greatest"]) == (3, 3, 1.0, 3.0)
    assert entry["median"] == 2.0 and entry["median_over_solved"] == 1.0
    assert entry["median_over_replay"] == pytest.approx(2.0 / 1.5)
    assert entry["bracketed"] == {"occupancy": 0, "rows": 1, "solved": 1, "replay": 1}
    # |0.4 - 0.5|, |0.3 - 0.5| and |0.2 - 0.5|
    assert entry["zero_from_baseline"] == pytest.approx(0.2)
    assert entry["lengths"] == {"strength": [0.0, 1.0], "soft": [4.0, 5.0], "greedy": [5.0, 5.0]}


def test_a_seed_that_never_leaves_the_baseline_leaves_no_median():
    entry = training.trained_summary(trained_tables([(1.0, 2.0), ("", "")]))["online"]["to_go"]
    assert (entry["left"], entry["median"], entry["median_over_solved"]) == (1, None, None)
    assert entry["bracketed"]["solved"] == 1
    nothing = trained_tables([(1.0, 2.0)]) | {"first_flips": []}
    assert training.trained_summary(nothing) == {}
