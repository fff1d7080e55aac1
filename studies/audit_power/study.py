"""Coverage of the audit's intervals and error rates of its verdicts, on simulated drivers."""

from typing import Any

from socialiq.audit.evidence.outcomes import check_episodes
from socialiq.learners.settings import check_counts
from socialiq_lab.study import Context, Findings
from studies.audit_power import heavy_tails, power
from studies.audit_power.grinding import TRIES, grinding_rows


def compute_tables(config: Any, context: Context) -> Findings:
    """Audit simulated drivers many times, and count."""
    check_episodes(config.episodes)
    check_counts(config, ("replications", "resamples", "owners"))
    episodes, number, seed = config.episodes, config.replications, config.first_seed
    resampling = config.resamples, context.on_stage
    coverage = power.coverage_rows(episodes, number, seed, *resampling)
    verdicts = power.verdict_rows(episodes, number, seed, *resampling)
    grinding = grinding_rows(episodes, config.owners, seed, *resampling)
    errors = heavy_tails.error_rows(episodes, number, seed, *resampling)
    long_audits = heavy_tails.long_audit_rows(episodes, number, seed)
    false_bounds = heavy_tails.false_bound_rows(episodes, number, seed)
    price = heavy_tails.price_rows(max(1, number // 8), seed, *resampling)
    tables = {
        "coverage": coverage,
        "verdicts": verdicts,
        "grinding": grinding,
        "heavy_tails": errors,
        "long_audits": long_audits,
        "false_bounds": false_bounds,
        "price": price,
    }
    off = [abs(row["covered"] - row["nominal"]) for row in coverage if row["exact"]]
    last = [row for row in grinding if row["tries"] == TRIES]
    summary = {
        "coverage": {row["interval"]: row for row in coverage},
        "verdicts": {row["case"]: row for row in verdicts},
        "farthest_off": max(off),
        "grinding": {f"{row['policy']}, {row['way']}": row for row in last},
        "heavy_tails": {f"{row['losses']}, {row['regret']}": row for row in errors},
        "long_audits": {row["losses"]: row for row in long_audits},
        "false_bounds": {row["losses"]: row for row in false_bounds},
        "price": {f"{row['losses']}, {row['episodes']}": row for row in price},
    }
    return Findings(tables, summary)
