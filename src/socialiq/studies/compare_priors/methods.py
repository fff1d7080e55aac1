"""The rows of the comparison: what each method is, in every world."""

from __future__ import annotations

from dataclasses import dataclass

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners.iq_learn import presets


@dataclass(frozen=True)
class Method:
    """One row. What it runs is told by the learner and the settings that differ from the world's.

    Attributes:
        name: Of the row, and of its folders.
        learner: Who trains it, a name of `learners.LEARNERS` and `intersection.LEARNERS`.
        prior: Of IQ-Learn: where the social score enters.
        target_kind: Of IQ-Learn: what the score is of.
        shift_term_3: Of the Bellman shift.
        scaled: Whether it has a λ (or 1/τ_w), which is then chosen on the development seeds.
        by_angle: Whether its training knows the target angle; else one policy serves all.
        readouts: What is evaluated.
    """

    name: str
    learner: str
    prior: str = "none"
    target_kind: str = "instantaneous"
    shift_term_3: bool = False
    scaled: bool = True
    by_angle: bool = True
    readouts: tuple[str, ...] = ("greedy", "soft")


IQ = "iq_learn"
METHODS = (
    Method("none", IQ, scaled=False, by_angle=False),
    Method("thesis", IQ, "reward", "running", scaled=False),
    Method("running", IQ, "reward", "running"),
    Method("to_go", IQ, "reward", "to_go"),
    Method("trajectory", IQ, "reward", "trajectory"),
    Method("instantaneous", IQ, "reward", "instantaneous"),
    Method("advantage", IQ, "reward", "advantage"),
    Method("shifted_chi2", IQ, "shifted_chi2"),
    # In term 1 the shift has no gradient, whatever λ and angle (tests/identities).
    Method("bellman_shift", IQ, "bellman_shift", "running", scaled=False, by_angle=False),
    Method("bellman_shift_1_3", IQ, "bellman_shift", "running", shift_term_3=True),
    Method("reweighting", IQ, "reweighting", "running"),
    Method("dial", "dial"),
    Method("clone", "clone", scaled=False, by_angle=False),
    Method("clone_of_mode", "clone_of_mode", scaled=False),
    Method("clone_weighted", "clone_weighted"),
    Method("cql", "cql"),
    Method("rl", "rl", scaled=False, readouts=("greedy",)),  # its soft form means nothing
)

BY_NAME = {method.name: method for method in METHODS}

LABELS = {
    "none": "IQ-Learn, no prior",
    "thesis": "running returns, the thesis' λ",
    "running": "running returns",
    "to_go": "returns-to-go",
    "trajectory": "whole-episode returns",
    "instantaneous": "instantaneous rewards",
    "advantage": "advantages",
    "shifted_chi2": "shifted χ², instantaneous",
    "bellman_shift": "Bellman shift, term 1",
    "bellman_shift_1_3": "Bellman shift, terms 1 and 3",
    "reweighting": "reweighting",
    "dial": "the dial, one network",
    "clone": "BC, pooled",
    "clone_of_mode": "BC of the nearest mode",
    "clone_weighted": "BC weighted by R(α)",
    "cql": "CQL on λ R(α)",
    "rl": "RL on R(α), no demonstrations",
}
"""Labels of the rows."""

THESIS_STRENGTHS = {
    "crossing5": presets.POC_STRENGTH,
    "crossing7": presets.GRID_STRENGTH,
    "intersection": presets.INTERSECTION_STRENGTH,
}
"""λ of each world's own study; also what stands in the column of methods that have none."""


def nearest_mode(angle: float) -> str:
    """The mode of the demonstrators whose angle is nearest; of two the more egoistic."""
    return min(MODES, key=lambda mode: abs(MODES[mode] - angle))
