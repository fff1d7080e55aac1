"""Audit from the thesis' printed tables alone (Tables 6.2, A.1, Fig 6.5)."""

import math

import numpy as np
from scipy.stats import t as student

from socialiq import Margin, RewardPair, score
from socialiq.audit.evidence.outcomes import CRITERIA
from socialiq.audit.verdict.regret import Decision
from socialiq.evaluation.rollout import MODES
from socialiq.social.angle import angle_of, arcs_of_grid, exact_weights
from socialiq.statistics.intervals import clopper_pearson, episodes_needed
from socialiq.types import Row
from socialiq_lab.intersection.thesis_values import FIG_6_5, POLICIES, TABLE_6_2, TABLE_A_1
from studies.audits.policies import floor_at

SEEDS = 5
"""Number of seeds of Table 6.2's spread. Their numbers of episodes are not printed."""


def return_rows(margin: Margin, error: float, episodes: int) -> list[Row]:
    """Audit Table A.1's experts at their own angles, with the other two as references.

    No covariance is printed. Therefore standard errors are bounded by the worst possible
    correlation, and the stated number of episodes suffices for any.
    """
    rows: list[Row] = []
    for mode, angle in MODES.items():
        (env, env_sd), (social, social_sd) = (
            TABLE_A_1[mode][name] for name in ("g_env", "g_social")
        )
        turning = (abs(env) * social_sd + abs(social) * env_sd) / math.hypot(env, social) ** 2
        regret, rival = _regret(mode, angle)
        spread = _value_sd(mode, angle) + _value_sd(rival, angle)
        row: Row = {"policy": f"expert {mode}", "declared": angle, "g_env": env, "g_social": social}
        row |= {"alpha_hat": angle_of(env, social)}
        row |= {"half_width": math.degrees(1.959964 * turning / math.sqrt(episodes))}
        row |= {"best_of_the_others": rival, "regret": regret}
        row |= {"deciding_episodes": episodes_needed(margin.regret - regret, spread, error)}
        row |= {"explained": _explained(mode, margin.regret), "best_at": _explained(mode, 0.0)}
        rows.append(row)
    return rows


def _means(mode: str) -> RewardPair:
    row = TABLE_A_1[mode]
    return RewardPair(row["g_env"][0], row["g_social"][0])


def _regret(mode: str, angle: float) -> tuple[float, str]:
    """Return the regret towards the better of the other two experts, and that expert."""
    values = {name: float(score(exact_weights(angle), _means(name))) for name in MODES}
    rival = max((name for name in MODES if name != mode), key=lambda name: values[name])
    return values[rival] - values[mode], rival


def _value_sd(mode: str, angle: float) -> float:
    """Return the largest possible standard deviation of R(α) of an episode."""
    env, social = (abs(weight) for weight in exact_weights(angle))
    return env * TABLE_A_1[mode]["g_env"][1] + social * TABLE_A_1[mode]["g_social"][1]


def _explained(mode: str, margin: float) -> str:
    """Return the arcs of whole degrees at which the expert is within a margin of the others."""
    inside = [_regret(mode, float(angle))[0] <= margin for angle in range(360)]
    arcs = arcs_of_grid(np.array(inside), 1.0)
    turned = [(arc.low - 360.0 * (arc.low > 180.0), arc.high - arc.low) for arc in arcs]
    return ", ".join(f"{low:g} to {low + width:g}" for low, width in turned) or "none"


def learner_angle_rows(margin: Margin) -> list[Row]:
    """Calibrate Fig 6.5's angles of the learners on the curve of Table A.1's experts."""
    angles = np.array(list(MODES.values()))
    achieved = np.array([angle_of(*_means(mode)) for mode in MODES])
    rows = []
    for mode, alpha_hat in FIG_6_5.items():
        assert (np.diff(achieved) > 0.0).all()
        row: Row = {"policy": mode, "declared": MODES[mode], "alpha_hat": alpha_hat}
        row |= dict.fromkeys(("calibrated", "distance", "within_margin"), "")
        if achieved[0] <= alpha_hat <= achieved[-1]:
            calibrated = float(np.interp(alpha_hat, achieved, angles))
            far = abs(calibrated - MODES[mode])
            row |= {"calibrated": calibrated, "distance": far}
            row["within_margin"] = int(far <= (margin.degrees or 0.0))
        rows.append(row)
    return rows


def floor_rows(error: float, episodes: int) -> list[Row]:
    """Test Table 6.2 against the floor of each policy's angle, by two kinds of bounds.

    `of_seeds` uses Student's bounds over the five seeds, whose spread is printed; `of_episodes`
    exact bounds with the given number of episodes. The table doesn't split collisions by who struck
    whom: they fail beyond the sum of both limits and pass within the smaller one. The baseline has
    the floor of 0 degrees. `error` is the probability of a wrong pass, and of a wrong fail.
    """
    rows = []
    for policy in POLICIES:
        floor = floor_at(MODES.get(policy.split()[-1], 0.0))
        struck = floor.max_at_fault, floor.max_struck
        limits = {  # beyond which a share fails for sure, and within which it passes
            "collision": (sum(struck), min(struck)),
            "arrival": (floor.min_arrival, floor.min_arrival),
            "timeout": (floor.max_timeout, floor.max_timeout),
        }
        for name, (fails, passes) in limits.items():
            mean, spread = (value / 100 for value in TABLE_6_2[name][policy])
            least, tails = name == "arrival", (error / 2 / len(CRITERIA), error)
            below, above = tails[::-1] if least else tails  # errors on either side
            error_of_mean, count = spread / math.sqrt(SEEDS), round(mean * episodes)
            off = [float(student.isf(tail, SEEDS - 1)) * error_of_mean for tail in (below, above)]
            bounds = {
                "seeds": (max(mean - off[0], 0.0), min(mean + off[1], 1.0)),
                "episodes": (
                    clopper_pearson(count, episodes, 1.0 - 2.0 * below).low,
                    clopper_pearson(count, episodes, 1.0 - 2.0 * above).high,
                ),
            }
            # At which chance alone gives the spread of a share.
            implied = round(mean * (1.0 - mean) / spread**2) if spread else ""
            row: Row = {"policy": policy, "criterion": name, "share": mean, "spread": spread}
            row |= {"implied_episodes": implied, "fails_beyond": fails, "passes_within": passes}
            for kind, (low, high) in bounds.items():
                decision = Decision.INCONCLUSIVE
                if (high < fails) if least else (low > fails):
                    decision = Decision.FAIL
                elif low >= passes if least else high <= passes:
                    decision = Decision.PASS
                row |= {f"{kind}_low": low, f"{kind}_high": high, f"of_{kind}": decision.value}
            rows.append(row)
    return rows
