import itertools

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.exact import Ground
from socialiq.evaluation.prediction import Setting, lines_of, predictions, problem_of
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.mdp.solve import evaluate_policy
from socialiq.theory.semi_gradient import demonstrated_policy
from socialiq_lab.registry import find
from socialiq_lab.study import run
from studies.theory import training


def flip(predicted, found, within=1, **changes):
    row = {
        "world": "crossing7",
        "angle": 0.0,
        "target_kind": "to_go",
        "next_value": "online",
        "predicted": predicted,
        "found": found,
        "within_reach": within,
        "tie": 0,
    }
    return row | changes


@pytest.mark.parametrize(
    ("predicted", "found", "hit"),
    [(1.14, 1.0, True), (0.86, 1.0, True), (1.16, 1.0, False), (1.0, "", False), ("", 1.0, False)],
)
def test_a_hit_is_within_15_percent_of_what_was_found(predicted, found, hit):
    assert training.hit(flip(predicted, found)) == hit


def test_hits_and_misses_are_counted_apart():
    rows = [
        flip(1.0, 1.05),
        flip(2.0, 4.0, within=0),
        flip(3.0, "", within=0),
        flip("", 5.0),
        flip("", ""),
        flip(0.0, 1e-6, tie=1),
        flip(9.0, 9.0, world="random 1"),
        flip(1.0, 1.0, next_value="target"),
    ]
    counts = training.flip_counts(rows, "online")
    assert counts == {
        "states": 6,
        "predicted": 4,
        "hits": 2,
        "not_found": 1,
        "found_unpredicted": 1,
        "neither": 1,
        "within_reach": 2,
        "within_reach_hits": 2,
        "first": 2,
        "first_hits": 2,
        "first_in_grids": 1,
        "first_in_grids_hits": 1,
        "first_in_grids_worst": pytest.approx(1 - 1 / 1.05),
        "ties": 1,
    }


def test_the_earliest_is_compared_with_the_earliest_found_anywhere():
    [first] = training.earliest([flip(1.0, 3.0), flip(2.0, 2.5), flip("", 0.5)])
    assert (first["predicted"], first["found"]) == (1.0, 0.5)


def test_a_strength_is_bracketed_by_the_grid_s_step():
    row = {"below": 0.5, "first": 1.0}
    assert [training.bracketed(row, strength) for strength in (0.5, 0.7, 1.0, 1.1)] == [
        False,
        True,
        True,
        False,
    ]
    assert not training.bracketed({"below": "", "first": ""}, 0.5)


def test_sampled_advantages_telescope():
    """Σ γ^t [r + γ (1 - d) V(s') - V(s)] = Σ γ^t r - V(s_0) in every whole episode."""
    ground = Ground.of("crossing7")
    problem = training.rows_problem(ground, "instantaneous")
    [data] = trajectory_datasets(ground.table, [0], 3)
    shaped = training.shaped_by_value(ground, problem, data)
    policy = demonstrated_policy(problem)
    policy[policy.sum(axis=1) == 0] = 1 / 3
    v = evaluate_policy(problem.mdp, policy, ground.part.mdp.rewards.env, 0.99).v
    [start] = np.flatnonzero(ground.part.mdp.initial == ground.part.mdp.initial.max())[:1]
    before, after = (one.returns("to_go", 0.99).env for one in (data, shaped))
    firsts = data.episode_starts
    known = {tuple(state): index for index, state in enumerate(ground.part.states)}
    begun = [known[tuple(row)] for row in data.observation[firsts].astype(int)]
    assert start in begun
    np.testing.assert_allclose(after[firsts], before[firsts] - v[begun], atol=1e-10)


def test_predictions_go_from_the_baseline_to_the_optimum(table7):
    part = table7.reachable_part()
    found = predictions(part, lines_of(problem_of(part, Setting(0.0)), "online"))
    assert found[0].before.angle == pytest.approx(152.121, abs=1e-3)
    assert found[-1].after.angle == pytest.approx(-42.274, abs=1e-3)
    for one, other in itertools.pairwise(found):
        assert one.flip.strength <= other.flip.strength
        assert one.after == other.before


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        (Setting(measure="batches"), "unknown measure"),
        (Setting(mixture="pools"), "unknown mixture"),
        (Setting(angle=360.0), "outside"),
        (Setting(target_kind="running"), "not a function of state and action"),
    ],
)
def test_settings_that_make_no_problem_are_refused(table7, setting, line):
    with pytest.raises(UserError, match=line):
        problem_of(table7.reachable_part(), setting)


def test_a_study_of_nothing_is_refused():
    study = find("theory")
    with pytest.raises(UserError, match="seeds must name at least one"):
        run(study, study.Config(seeds=()))
