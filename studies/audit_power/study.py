"""Coverage of the audit's intervals and error rates of its verdicts, on simulated drivers."""

from pathlib import Path
from typing import Any

from socialiq.audit.seeds import check_episodes
from socialiq.types import Row
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from socialiq_lab.study import Context, Findings
from studies.audit_power import grinding, heavy_tails, power

TABLES = {
    "coverage": power.coverage_rows,
    "verdicts": power.verdict_rows,
    "grinding": grinding.grinding_rows,
    "heavy_tails": heavy_tails.error_rows,
    "long_audits": lambda config, _: heavy_tails.long_audit_rows(config),
    "false_bounds": lambda config, _: heavy_tails.false_bound_rows(config),
    "price": heavy_tails.price_rows,
}


def jobs(config: Any) -> list[Job]:
    """Return a job for each table.

    Raises:
        UserError: If there are too few episodes.
    """
    check_episodes(config.episodes)
    return [Job(f"tables/{name}", table_rows, Part(config, name)) for name in TABLES]


@keeps_rows
def table_rows(part: Part, _folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Audit simulated drivers many times, and count, for a table."""
    return {part.of: TABLES[part.of](part.study, on_stage)}


def compute_tables(_config: Any, context: Context) -> Findings:
    """Return what the jobs have kept.

    Args:
        context: The finished jobs.

    Returns:
        All tables, and how far a coverage is from its nominal value at most.
    """
    tables = context.tables()
    off = [abs(row["covered"] - row["nominal"]) for row in tables["coverage"] if row["exact"]]
    return Findings(tables, {"farthest_off": max(off)})
