"""Coverage of the audit's intervals and error rates of its verdicts, on simulated drivers."""

from typing import Any

from socialiq.audit.seeds import check_episodes
from socialiq_lab.study import Context, Findings
from studies.audit_power import grinding, heavy_tails, power


def compute_tables(config: Any, context: Context) -> Findings:
    """Audit simulated drivers many times, and count.

    Args:
        config: Configuration of the study.
        context: Progress callback; the study has no jobs.

    Returns:
        All tables, and how far a coverage is from its nominal value at most.

    Raises:
        UserError: If there are too few episodes, or a count is below 1.
    """
    check_episodes(config.episodes)
    tables = {
        "coverage": power.coverage_rows(config, context.on_stage),
        "verdicts": power.verdict_rows(config, context.on_stage),
        "grinding": grinding.grinding_rows(config, context.on_stage),
        "heavy_tails": heavy_tails.error_rows(config, context.on_stage),
        "long_audits": heavy_tails.long_audit_rows(config),
        "false_bounds": heavy_tails.false_bound_rows(config),
        "price": heavy_tails.price_rows(config, context.on_stage),
    }
    off = [abs(row["covered"] - row["nominal"]) for row in tables["coverage"] if row["exact"]]
    return Findings(tables, {"farthest_off": max(off)})
