"""Audits of the thesis' printed tables and of this project's policies.

The thesis says that a recovered angle allows others to verify a declared one (7.1, 9.2).
"""

import datetime
import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from socialiq import Margin, RewardPair, score
from socialiq.audit.conduct import conduct
from socialiq.audit.evidence.outcomes import CRITERIA
from socialiq.audit.profile.template import floor_at
from socialiq.audit.report.words import degrees
from socialiq.audit.request import Request
from socialiq.audit.seeds import check_episodes
from socialiq.audit.verdict.decision import Decision
from socialiq.errors import one_of
from socialiq.evaluation.rollout import MODES
from socialiq.social.angle import angle_of, arcs_of_grid, exact_weights
from socialiq.statistics.intervals import clopper_pearson, episodes_needed
from socialiq.types import Row
from socialiq_lab.audit_arena import default_declaration
from socialiq_lab.intersection.thesis_values import FIG_6_5, POLICIES, TABLE_6_2, TABLE_A_1
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings, silent, tracked
from socialiq_lab.tables import column, matching, nested
from studies.audits import policies as audited

REPORT = declaration("audits")["report"]
"""Place of each column in the report of an audit."""

SEEDS = 5
"""Number of seeds of Table 6.2's spread. Their numbers of episodes are not printed."""


def return_rows(margin: Margin, error: float, episodes: int) -> list[Row]:
    """Audit Table A.1's experts at their own angles; the references are the remaining two experts.

    No covariance is printed. Therefore standard errors are bounded by the worst possible
    correlation, and the stated number of episodes suffices for any.

    Args:
        margin: Margins of regret and angle.
        error: Error of the test that the column `deciding_episodes` belongs to.
        episodes: Assumed number of episodes for the half width of α̂, because none is printed.

    Returns:
        A row for each expert.
    """
    rows: list[Row] = []
    for mode, angle in MODES.items():
        (env, env_sd), (social, social_sd) = (
            TABLE_A_1[mode][name] for name in ("g_env", "g_social")
        )
        turning = (abs(env) * social_sd + abs(social) * env_sd) / math.hypot(env, social) ** 2
        regret, rival = _regret(mode, angle)
        spread = _value_sd(mode, angle) + _value_sd(rival, angle)
        rows.append(
            {
                "policy": f"expert {mode}",
                "declared": angle,
                "g_env": env,
                "g_social": social,
                "alpha_hat": angle_of(env, social),
                "half_width": math.degrees(1.959964 * turning / math.sqrt(episodes)),
                "best_of_the_others": rival,
                "regret": regret,
                "deciding_episodes": episodes_needed(margin.regret - regret, spread, error),
                "explained": _explained(mode, margin.regret),
                "best_at": _explained(mode, 0.0),
            }
        )
    return rows


def _means(mode: str) -> RewardPair:
    row = TABLE_A_1[mode]
    return RewardPair(row["g_env"][0], row["g_social"][0])


def _regret(mode: str, angle: float) -> tuple[float, str]:
    """Return the regret towards the better of the two rival experts, and that expert."""
    values = {name: float(score(exact_weights(angle), _means(name))) for name in MODES}
    rival = max((name for name in MODES if name != mode), key=lambda name: values[name])
    return values[rival] - values[mode], rival


def _value_sd(mode: str, angle: float) -> float:
    """Return the largest possible standard deviation of R(α) of an episode."""
    env, social = (abs(weight) for weight in exact_weights(angle))
    return env * TABLE_A_1[mode]["g_env"][1] + social * TABLE_A_1[mode]["g_social"][1]


def _arcs(ranges: Sequence[Mapping[str, float]]) -> str:
    """Return whole arcs in one line; those that begin beyond 180 degrees begin below 0."""
    texts = []
    for arc in ranges:
        low = arc["low"] - 360.0 * (arc["low"] > 180.0)
        texts.append(f"{degrees(low)} to {degrees(low + arc['high'] - arc['low'])}")
    return ", ".join(texts) or "none"


def _explained(mode: str, margin: float) -> str:
    """Return the arcs of whole degrees at which the expert is within a margin of its rivals."""
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
    the floor of 0 degrees.

    Args:
        error: Probability of a wrong pass, and of a wrong fail.
        episodes: Number of episodes of the exact bounds.

    Returns:
        A row for each policy and criterion: collision, arrival and timeout.
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
            least = name == "arrival"
            tails = error / 2 / len(CRITERIA), error
            below, above = tails[::-1] if least else tails  # errors on either side
            error_of_mean = spread / math.sqrt(SEEDS)
            count = round(mean * episodes)
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
            row: Row = {
                "policy": policy,
                "criterion": name,
                "share": mean,
                "spread": spread,
                "implied_episodes": implied,
                "fails_beyond": fails,
                "passes_within": passes,
            }
            for kind, (low, high) in bounds.items():
                decision = Decision.INCONCLUSIVE
                if (high < fails) if least else (low > fails):
                    decision = Decision.FAIL
                elif low >= passes if least else high <= passes:
                    decision = Decision.PASS
                row |= {f"{kind}_low": low, f"{kind}_high": high, f"of_{kind}": decision.value}
            rows.append(row)
    return rows


DAY = datetime.date(2026, 11, 1)
PUBLISHED = Margin(1.0, 10.0)
"""Margins of the printed numbers: of regret, reward per episode, and of the angle, degrees."""
ERROR = 0.05


def compute_tables(config: Any, context: Context) -> Findings:
    """Return what the jobs have kept, the printed tables, and the summary.

    Args:
        config: Configuration of the study.
        context: The finished jobs.

    Returns:
        Table `audits`, the tables of `published_tables`, and the summary.
    """
    tables = {**context.tables(), **published_tables(config.published_episodes)}
    return Findings(tables, _summary(tables))


def jobs(config: Any) -> list[Job]:
    """Return a job for each world.

    Raises:
        UserError: If there are too few episodes, or a world has no policies.
    """
    check_episodes(config.episodes)
    worlds = "intersection", audited.GRIDWORLD
    for world in config.worlds:
        one_of("world", world, worlds)
    return [
        Job(f"audits/{world}", audits, Part(config, world))
        for world in worlds
        if world in config.worlds
    ]


@keeps_rows
def audits(part: Part, _folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Audit the policies of a world; those of the gridworld are trained first."""
    config = part.study
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if part.of == audited.GRIDWORLD:
            updates = config.updates, config.dial_updates
            audited.exact_in_gridworld(folder)
            audited.trained_in_gridworld(folder, config.training_seed, updates, on_stage)
            policies = list(audited.of_gridworld(folder, config.dial_angles))
        else:
            policies = list(audited.at_intersection(folder))
        rows = audit_rows(policies, config.episodes, config.seed, folder, on_stage)
    return {"audits": rows}


def published_tables(episodes: int) -> dict[str, list[Row]]:
    """Return the tables of the printed numbers, for this many episodes where none are stated."""
    return {
        "published_returns": return_rows(PUBLISHED, ERROR, episodes),
        "published_angles": learner_angle_rows(PUBLISHED),
        "published_floor": floor_rows(ERROR, episodes),
    }


def audit_rows(
    policies: Sequence[audited.AuditedPolicy],
    episodes: int,
    seed: int,
    folder: Path,
    on_stage: StageCallback = silent,
) -> list[Row]:
    """Declare and audit each policy, all of one world, in a folder; return a row for each."""
    rows = []
    profile = folder / "profile.toml"
    for policy in tracked(policies, on_stage, f"audits, {policies[0].world}", "audits"):
        declaration = policy.world, policy.declared, None, policy.floor
        declared = default_declaration(*declaration, False, "the study of audits", DAY)
        # Without the template's comments, whose wording would otherwise determine the episodes.
        lines = [line for line in declared.source.splitlines() if line and line[:1] != b"#"]
        profile.write_bytes(b"\n".join(lines))
        request = Request(policy.spec, profile, episodes, seed)
        report = conduct(request, lambda _: None).report
        tests = report["tests"]
        decision = report["verdict"]["decision"]
        decisions = {name: tests[name]["decision"] for name in ("regret", "direction", "character")}
        decisions |= {test["name"]: test["decision"] for test in tests["competence"]}
        # The failed tests, or the open ones of an inconclusive verdict; none of a pass.
        deciding = [name for name, result in decisions.items() if result == decision]
        computed = {
            "decided_by": "" if decision == "pass" else ", ".join(deciding),
            "min_arrival": policy.floor.min_arrival,
            "explained": _arcs(tests["rationalised"]["arcs"]),
        }
        row = {
            "world": policy.world,
            "policy": policy.name,
            "made_for": policy.made_for,
            "declared": policy.declared,
            "truthful": int(policy.truthful),
            **{name: computed.get(name, _at(report, place)) for name, place in REPORT.items()},
        }
        rows.append({name: "" if value is None else value for name, value in row.items()})
    return rows


def _at(report: Any, path: str) -> Any:
    """Return the value at a dotted path of a report, None if one of its parts is missing."""
    for key in path.split("."):
        report = (report or {}).get(key)
    return report


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Counts of verdicts, and the printed tables."""
    floor = nested(tables["published_floor"], "policy", "criterion", keep="all")
    failing = {
        name: sum("fail" in column([*tests.values()], name) for tests in floor.values())
        for name in ("of_seeds", "of_episodes")
    }

    def counts(name: str) -> dict[str, dict[str, int]]:
        """Count decisions on policies with a target, by whether they are rightly declared."""
        result = {}
        for kind, truth in (("truthful", 1), ("false", 0)):
            rows = [row for row in tables["audits"] if row["made_for"] != ""]
            decisions = column(matching(rows, truthful=truth), name)
            kinds = {kind: decisions.count(kind) for kind in ("pass", "fail", "inconclusive")}
            result[kind] = {"audits": len(decisions), **kinds}
        return result

    return {
        "counts": counts("verdict"),
        "angle_test": counts("direction"),
        "published": {
            "returns": nested(tables["published_returns"], "policy", keep="all"),
            "angles": nested(tables["published_angles"], "policy", keep="all"),
            "floor": floor,
            "floor_failing": failing,
            "policies": len(floor),
        },
    }
