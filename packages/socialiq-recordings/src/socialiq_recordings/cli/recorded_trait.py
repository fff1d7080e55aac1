"""The angle as a trait, as a part of `data predict`: what it gains over its rivals."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from socialiq.cli.output import print_table, say
from socialiq.errors import UserError
from socialiq.types import Row
from socialiq_recordings.prediction import study
from socialiq_recordings.prediction.situation import Situations
from socialiq_recordings.trait.contrasts import chains_to_find_anything, contrasts, scores
from socialiq_recordings.trait.hierarchy import direction
from socialiq_recordings.trait.models import fit_models

_CONFIDENCE = 0.95


@dataclass(frozen=True)
class TraitTest:
    """Test of the angle as a trait.

    Attributes:
        tables: `trait_models` and `trait_contrasts`; nothing if it could not be tested.
        summary: Counts, the population's angle, and which contrasts were found.
    """

    tables: dict[str, list[Row]] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)

    def show(self) -> None:
        """Print the contrasts, or the reason for which there are none."""
        if "not_tested" in self.summary:
            say(f"the angle as a trait is not tested: {self.summary['not_tested']}")
        if not self.tables:
            return
        of = self.summary
        print_table(
            [_line(row) for row in self.tables["trait_contrasts"]],
            f"\nA driver's angle from its first half, on its second: {of['decisions']} decisions, "
            f"{of['drivers']} drivers, {of['chains']} chains",
        )
        say_if_too_few(of["chains"], of["chains_needed"])


NOT_TESTED = TraitTest()
"""The test left out."""


def say_if_too_few(chains: int, needed: int) -> None:
    """Say that so few independent chains can't show a gain, if that is so."""
    if chains < needed:
        say(
            f"not enough data: with {chains} independent chains no gain can be found "
            f"after correction, whatever its size; {needed} are needed"
        )


def trait_test(seen: Situations, seed: int) -> TraitTest:
    """Infer angles from drivers' first halves and test them on their second halves.

    Args:
        seen: All moments.
        seed: Of the base predictor, the shuffling and the resampling.
    """
    try:
        models = fit_models(study.choices(seen, seed), seed, narrow=True)
    except UserError as error:
        return TraitTest(summary={"not_tested": str(error)})
    rows, sample = contrasts(models, seed), models.sample
    population = models.angle.population
    angle = direction(population.trait.mean, population.chance.sum(axis=0), _CONFIDENCE)
    spread = population.quantiles("spread", (0.025, 0.5, 0.975))
    return TraitTest(
        {"trait_models": scores(models), "trait_contrasts": rows},
        {
            "decisions": int(sample.second.sum()),
            "drivers": len(sample.identity),
            "chains": len(set(sample.chain.tolist())),
            "chains_needed": chains_to_find_anything(),
            "found": [row["angle_over"] for row in rows if row["found"]],
            "population_angle": angle._asdict(),
            "population_spread": dict(zip(("low", "median", "high"), spread, strict=True)),
        },
    )


def _line(row: Row) -> Row:
    return {
        "angle over": row["angle_over"],
        "gain, nats": f"{row['gain_nats']:+.3f} ({row['low']:+.3f} to {row['high']:+.3f})",
        "p": f"{row['p']:.3f}",
        "p, Holm": f"{row['p_holm']:.3f}",
        "less RMSE": f"{100 * row['rmse_gain']:+.1f} %",
        "found": "yes" if row["found"] else "no",
    }
