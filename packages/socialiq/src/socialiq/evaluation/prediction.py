"""Predictions of the theory for a gridworld's three experts, before any training."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.errors import one_of
from socialiq.evaluation.exact import Metrics, evaluate_exactly
from socialiq.evaluation.rollout import MODES
from socialiq.mdp.horizon import horizon_evaluation
from socialiq.social.angle import check_angle, exact_weights, score
from socialiq.theory import response, semi_gradient
from socialiq.theory.demonstrators import drawn_rows, mean_target, occupancies
from socialiq.theory.objective import Problem, orthogonal
from socialiq.worlds.enumerate import Table
from socialiq.worlds.tabular_policy import expert_policy

DISCOUNT = 0.99  # γ and γ_svo of Table C.1
MEASURES = ("occupancy", "rows")
MIXTURES = ("equal_trajectories", "equal_transitions")
NextValue = Literal["online", "target"]
NEXT_VALUES: tuple[NextValue, ...] = ("online", "target")


class Setting(NamedTuple):
    """Setting of a prediction: the pooled demonstrations, and the learner's target.

    Attributes:
        angle: α in degrees.
        target_kind: A name of `theory.demonstrators.TARGET_KINDS`.
        mixture: Equal numbers of episodes of each expert, or of transitions.
        measure: Discounted occupancies of endless episodes, as in the theorems, or uniformly drawn
            rows of episodes of the world's horizon, as in batches.
    """

    angle: float = 0.0
    target_kind: str = "instantaneous"
    mixture: str = "equal_trajectories"
    measure: str = "occupancy"


class Prediction(NamedTuple):
    """Predicted strength at which the greedy action of a state changes.

    Attributes:
        flip: State whose action changes, and λ of the change.
        exact: Whether the straight lines are exact up to this change (`response.reach`).
        before: The greedy policy below that λ, evaluated exactly.
        after: The greedy policy above that λ, evaluated exactly.
    """

    flip: response.Flip
    exact: bool
    before: Metrics
    after: Metrics


class Lines(NamedTuple):
    """Straight lines in λ, one for each (state, action); the greedy action has the largest.

    Attributes:
        level: Value at λ = 0: ρ_E, or the demonstrators' shares of actions.
        slope: The derivative by λ.
    """

    level: Float[np.ndarray, "state action"]
    slope: Float[np.ndarray, "state action"]


def problem_of(table: Table, setting: Setting) -> Problem:
    """Return the objective for the pool of the three experts (5.2), with Table C.1's settings.

    Args:
        table: The world, or its reachable part.
        setting: Setting of the prediction.

    Raises:
        UserError: If the angle or a name in the setting is invalid.
    """
    one_of("measure", setting.measure, MEASURES)
    one_of("mixture", setting.mixture, MIXTURES)
    mdp = table.mdp
    horizon = table.world.horizon
    policies = [expert_policy(table, angle) for angle in MODES.values()]
    reward = score(exact_weights(check_angle(setting.angle)), mdp.rewards)
    weight = np.ones(len(policies))
    if setting.mixture == "equal_transitions":
        weight = 1.0 / np.array([horizon_evaluation(mdp, p, horizon).length for p in policies])
    shares = [float(share) for share in weight / weight.sum()]
    kind = setting.target_kind
    if setting.measure == "rows":
        rows = drawn_rows(mdp, policies, shares, reward, kind, horizon, DISCOUNT)
        return Problem(rows.mdp, rows.shares, rows.target, discount=DISCOUNT)
    # A state that is not visited may have a measure just below 0, by rounding.
    occupancy = np.maximum(occupancies(mdp, policies, shares, DISCOUNT), 0.0)
    target = mean_target(mdp, policies, occupancy, reward, kind, DISCOUNT)
    return Problem(mdp, occupancy.sum(axis=0), target, discount=DISCOUNT)


def lines_of(problem: Problem, next_value: NextValue) -> Lines:
    """Return the lines of the greedy choice in λ, as τ → 0.

    Args:
        problem: The objective.
        next_value: "online" passes the gradient through V(s'), "target" doesn't (a target network).

    Raises:
        UserError: If the next value is another word.
    """
    one_of("next value", next_value, NEXT_VALUES)
    if next_value == "target":
        level = semi_gradient.demonstrated_policy(problem)
        return Lines(level, semi_gradient.policy_slope(problem))
    level = np.where(problem.support, problem.demonstrated, 0.0)
    return Lines(level, response.occupancy_slope(problem))


def target_norm(problem: Problem) -> float:
    """Return ‖T_⊥‖ per row; λ ‖T_⊥‖ depends neither on the target's unit nor on its shaping."""
    mass = problem.demonstrated.sum()
    norm = orthogonal(problem.mdp, problem.demonstrated, problem.target, problem.discount).norm
    return float(norm / np.sqrt(mass))


def predictions(table: Table, lines: Lines) -> list[Prediction]:
    """Return every flip predicted at a finite λ, with the greedy policies on both sides.

    Args:
        table: The world of the lines.
        lines: Lines of the greedy choice.

    Returns:
        Flips by ascending λ.
    """
    reach = response.reach(*lines)
    before = evaluate_exactly(table, _greedy(lines, 0.0))
    flips = []
    for flip in response.flips(*lines):
        if np.isfinite(flip.strength):
            after = evaluate_exactly(table, _greedy(lines, flip.strength * (1.0 + 1e-9)))
            flips.append(Prediction(flip, flip.strength <= reach, before, after))
            before = after
    return flips


def _greedy(lines: Lines, strength: float) -> Float[np.ndarray, "state action"]:
    """Return the one-hot policy of the highest line; the first action without demonstrations."""
    height = np.where(lines.level > 0.0, lines.level + strength * lines.slope, -np.inf)
    return np.eye(height.shape[1])[height.argmax(axis=1)]
