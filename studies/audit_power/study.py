"""Coverage of the audit's intervals and error rates of its verdicts, on simulated drivers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from socialiq.audit.evidence.outcomes import FEWEST_EPISODES
from socialiq.errors import UserError
from socialiq.types import Row
from socialiq_lab.study import Context, Findings, counter
from studies.audit_power.grinding import TRIES, grinding_rows
from studies.audit_power.heavy_tails import (
    SIZES,
    TAILS,
    TIMES,
    error_rows,
    false_bound_rows,
    long_audit_rows,
    price_rows,
)
from studies.audit_power.power import coverage_rows, verdict_rows


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    episodes: int = 500
    """Episodes of an audit."""
    replications: int = 2000
    """Audits of each population."""
    resamples: int = 1000
    """Resamples of each bootstrap."""
    owners: int = 4000
    """Owners of each policy who try up to 20 times."""
    first_seed: int = 100_000
    """Seed of the first audit; the others follow. Seeds below 10,000 were for development."""

    def __post_init__(self) -> None:
        """Refuse numbers that are too small for an audit."""
        least_of = {"episodes": FEWEST_EPISODES, "replications": 1, "resamples": 2, "owners": 1}
        for name, least in least_of.items():
            if getattr(self, name) < least:
                raise UserError(f"{name} must be at least {least}, got {getattr(self, name)}")


def compute_tables(config: Config, context: Context) -> Findings:
    """Audit simulated drivers many times, and count."""
    sizes = config.episodes, config.replications, config.first_seed, config.resamples
    count = partial(counter, context.on_stage, total=config.replications, unit="audits")
    tables = {
        "coverage": coverage_rows(*sizes, on_progress=count("coverage")),
        "verdicts": verdict_rows(*sizes, on_progress=count("error rates")),
        "grinding": _grinding(config, context),
        **_heavy_tails(config, context),
    }
    return Findings(tables, _summary(tables))


def _grinding(config: Config, context: Context) -> list[Row]:
    """Count the owners who pass by trying again."""
    on_progress = counter(context.on_stage, "grinding", config.owners, "owners")
    sizes = config.episodes, config.owners, config.first_seed, config.resamples
    return grinding_rows(*sizes, on_progress=on_progress)


def _heavy_tails(config: Config, context: Context) -> dict[str, list[Row]]:
    """Count wrong passes of policies with rare large losses, and passes of good ones."""

    def cases(stage: str, total: int) -> Any:
        return counter(context.on_stage, stage, total=total, unit="cases")

    sizes = config.episodes, config.replications, config.first_seed
    audits = max(1, config.replications // 8)
    wrong, price = len(TAILS) * len(TIMES), len(TAILS) * len(SIZES)
    return {
        "heavy_tails": error_rows(*sizes, config.resamples, cases("heavy tails", wrong)),
        "long_audits": long_audit_rows(*sizes),
        "false_bounds": false_bound_rows(*sizes),
        "price": price_rows(audits, config.first_seed, config.resamples, cases("price", price)),
    }


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Rows by name, and the largest deviation of an exact interval from its nominal coverage."""
    off = [abs(row["covered"] - row["nominal"]) for row in tables["coverage"] if row["exact"]]
    return {
        "coverage": {row["interval"]: row for row in tables["coverage"]},
        "verdicts": {row["case"]: row for row in tables["verdicts"]},
        "farthest_off": max(off),
        "grinding": {
            f"{row['policy']}, {row['way']}": row
            for row in tables["grinding"]
            if row["tries"] == TRIES
        },
        "heavy_tails": {f"{row['losses']}, {row['regret']}": row for row in tables["heavy_tails"]},
        "long_audits": {row["losses"]: row for row in tables["long_audits"]},
        "false_bounds": {row["losses"]: row for row in tables["false_bounds"]},
        "price": {f"{row['losses']}, {row['episodes']}": row for row in tables["price"]},
    }
