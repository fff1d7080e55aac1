import numpy as np
import pytest

from socialiq.evaluation.context import (
    StateAngles,
    by_turning,
    consistent,
    decision_loss,
    evaluate_by_rule,
    planned,
    state_angles,
)
from socialiq.evaluation.exact import Optimum, evaluate_exactly
from socialiq.mdp.front import attainable_set
from socialiq.social.angle import exact_weights
from socialiq.social.angle_rule import AngleRule
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.registry import make_grid

WORLDS = ("crossing5", "crossing7")
MEANINGS = (by_turning, consistent, planned)


@pytest.fixture(name="tables", scope="module")
def both_worlds():
    return {name: tabulate(make_grid(name)).reachable_part() for name in WORLDS}


def rule_of(world: str, default: float, angle: float | None = None) -> AngleRule:
    when = [] if angle is None else [{"angle": angle, "approaching": {"at_least": 1}}]
    return AngleRule.of({"format": 1, "world": world, "default": default, "when": when})


def constant(table: Table, angle: float) -> StateAngles:
    return state_angles(table, rule_of(table.world.name, angle))


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("angle", [0.0, 40.0, 75.0])
def test_at_a_constant_angle_the_loss_is_the_regret(tables, world, angle):
    table = tables[world]
    best, rule = Optimum(table), rule_of(world, angle)
    random = np.random.default_rng(0).dirichlet(np.ones(table.mdp.n_actions), table.mdp.n_states)
    others = [by_turning(table, constant(table, other)) for other in (0.0, 45.0, 90.0)]
    for policy in (random, *others):
        regret = best.regret(evaluate_exactly(table, policy), angle)
        found = evaluate_by_rule(table, policy, rule)
        assert found.loss.sum() == pytest.approx(regret, abs=1e-9)


@pytest.mark.parametrize("world", WORLDS)
def test_all_meanings_agree_at_a_constant_angle(tables, world):
    table, rule = tables[world], rule_of(world, 50.0)
    for meaning in MEANINGS:
        found = evaluate_by_rule(table, meaning(table, constant(table, 50.0)), rule)
        assert found.loss.sum() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("world", WORLDS)
def test_each_meaning_is_best_by_its_own_measure(tables, world):
    table, rule = tables[world], rule_of(world, 0.0, 75.0)
    angles = state_angles(table, rule)
    found = {one: evaluate_by_rule(table, one(table, angles), rule) for one in MEANINGS}
    assert found[by_turning].loss.sum() == pytest.approx(0.0, abs=1e-9)
    assert found[planned].weighed >= max(one.weighed for one in found.values()) - 1e-9
    assert found[planned].loss.sum() > 0.5
    assert (decision_loss(table, angles.degrees) >= -1e-9).all()


@pytest.mark.parametrize("world", WORLDS)
def test_no_single_decision_improves_the_consistent_policy(tables, world):
    """By the angle of its state, given that all later decisions follow the policy."""
    table = tables[world]
    when = {"angle": 75, "cells_to_conflict": {"at_least": 1, "at_most": 1}}
    rule = AngleRule.of({"format": 1, "world": world, "default": 0, "when": [when]})
    angles = state_angles(table, rule)
    policy, mdp = consistent(table, angles), table.mdp
    weights = np.array([exact_weights(one) for one in angles.degrees.tolist()])
    after = np.zeros((2, mdp.n_states))
    for chances in policy[::-1]:
        sides = [r + mdp.expected_next(v) for r, v in zip(mdp.rewards, after, strict=True)]
        scored = weights[:, :1] * sides[0] + weights[:, 1:] * sides[1]
        assert np.allclose((chances * scored).sum(axis=1), scored.max(axis=1), atol=1e-9)
        after = np.stack([(chances * side).sum(axis=1) for side in sides])


def test_no_rule_is_above_the_front_of_constant_angles(tables):
    table = tables["crossing7"]
    front = attainable_set(table.mdp, table.world.horizon)
    for low, high in ((0.0, 45.0), (20.0, 65.0), (80.0, 10.0)):
        rule = rule_of("crossing7", low, high)
        for meaning in MEANINGS:
            totals = evaluate_by_rule(table, meaning(table, state_angles(table, rule)), rule).totals
            assert front.contains(totals)


def test_a_step_by_step_score_prefers_the_egoist_to_the_driver_who_yields(
    tables,
):
    """The others' loss falls after the ego has passed, where the rule no longer counts it."""
    table, rule = tables["crossing5"], rule_of("crossing5", 0.0, 75.0)
    yields = evaluate_by_rule(table, by_turning(table, state_angles(table, rule)), rule)
    egoist = evaluate_by_rule(table, by_turning(table, constant(table, 0.0)), rule)
    assert (round(yields.weighed, 3), round(egoist.weighed, 3)) == (4.551, 5.326)
    assert yields.loss.sum() == pytest.approx(0.0, abs=1e-9)
    assert round(egoist.loss.sum(), 3) == 0.966
