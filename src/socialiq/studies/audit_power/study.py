"""Reliability of an audit's numbers: its intervals and verdicts on simulated drivers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from socialiq.audit.evidence.outcomes import FEWEST_EPISODES
from socialiq.errors import UserError
from socialiq.experiments.study import Context, Findings, counter
from socialiq.studies.audit_power.power import Coverage, Rates, coverage, error_rates
from socialiq.types import Row


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    episodes: int = 500
    """Episodes of an audit."""
    replications: int = 2000
    """Audits of each population."""
    resamples: int = 1000
    """Resamples of each bootstrap."""
    first_seed: int = 100_000
    """Seed of the first audit; the others follow. Seeds below 10,000 were for development."""

    def __post_init__(self) -> None:
        """Raise an error for numbers without which there is no audit."""
        for name, least in (("episodes", FEWEST_EPISODES), ("replications", 1), ("resamples", 2)):
            if getattr(self, name) < least:
                raise UserError(f"{name} must be at least {least}, got {getattr(self, name)}")


def compute_tables(config: Config, context: Context) -> Findings:
    """Audit made-up drivers many times, and count."""
    sizes = config.episodes, config.replications, config.first_seed, config.resamples
    count = partial(counter, context.on_stage, total=config.replications, unit="audits")
    covered = coverage(*sizes, on_progress=count("coverage"))
    rates = error_rates(*sizes, on_progress=count("error rates"))
    tables = {
        "coverage": [_coverage_row(one) for one in covered],
        "verdicts": [_verdict_row(one) for one in rates],
    }
    return Findings(tables, _summary(tables))


def _coverage_row(one: Coverage) -> Row:
    return {
        "interval": one.interval,
        "nominal": one.nominal,
        "covered": one.covered.value,
        "low": one.covered.low,
        "high": one.covered.high,
        "exact": int(one.exact),
    }


def _verdict_row(one: Rates) -> Row:
    row: Row = {"case": one.case}
    for kind in ("passed", "failed", "inconclusive"):
        share = getattr(one, kind)
        row |= {kind: share.value, f"{kind}_low": share.low, f"{kind}_high": share.high}
    return row


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Rows by name, and how far the worst interval that should be met exactly is off."""
    off = [abs(row["covered"] - row["nominal"]) for row in tables["coverage"] if row["exact"]]
    return {
        "coverage": {row["interval"]: row for row in tables["coverage"]},
        "verdicts": {row["case"]: row for row in tables["verdicts"]},
        "farthest_off": max(off),
    }
