"""`data predict`: driver models and what they predict of recorded drivers that are held out."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import Printing, print_json, print_table, say
from socialiq.errors import UserError
from socialiq.plotting.style import png
from socialiq.results_folder import Results, check_target, save
from socialiq.statistics.clusters import clusters_needed, least_p
from socialiq.types import Row
from socialiq_recordings.cli.files import load_identified, sources_of
from socialiq_recordings.identity.duplicates import Duplicates
from socialiq_recordings.prediction import learned, scores, study
from socialiq_recordings.prediction.models import ensembles
from socialiq_recordings.prediction.scores import ERROR
from socialiq_recordings.prediction.situations import Situations, situations_of
from socialiq_recordings.prediction.study import HOLDOUTS, Holdout
from socialiq_recordings.trait.hierarchy import direction
from socialiq_recordings.trait.models import chains_to_find_anything, fit_models
from socialiq_recordings.trait.models import contrasts as trait_contrasts
from socialiq_recordings.trait.models import scores as trait_scores

LIMITS = (
    "Lights are not in recordings: a vehicle that stands at one looks like one that gives way.",
    "Routes are taken as known, and displacement is measured along them.",
    "Rows of one chain are not independent: intervals resample chains, and few chains make them "
    "rough.",
)
"""Limits of a prediction."""


@dataclass(frozen=True)
class Predict(Printing):
    """Fit driver models and predict held-out drivers: next acceleration, position after 3 s.

    Example: socialiq data predict a.safetensors b.safetensors --out prediction
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`."""
    out: Path | None = None
    """Folder to write: scores, contrasts of models, folds, the test of angles, a figure."""
    holdout: tuple[Holdout, ...] = ()
    """Held-out things; by default all that these recordings allow."""
    models: tuple[str, ...] = ()
    """Names of models; by default all. The trivial ones are always beside them."""
    road: Path | None = None
    """Map of recordings without one: CommonRoad XML, Lanelet2 OSM, or a recording."""
    duplicates: Duplicates = "drop"
    """Vehicles whose moments are in several recordings: count each once, keep all, or refuse."""
    updates: int = learned.Training.updates
    """Gradient steps of each learned policy."""
    seed: int = 0
    """Seed of training and resampling."""
    without_trait: bool = False
    """Leave out the test of a driver's angle, inferred from its first half, on its second."""
    replace: bool = False
    """Replace earlier results in the folder."""

    def run(self) -> int:
        """Fit, predict, score, write, print."""
        config = self._config()
        if self.out is not None:
            check_target(self.out, self.replace)
        recordings, identified = load_identified(
            self.recordings, self.road, self.duplicates, self.json
        )
        situations = situations_of(recordings, identified, self.duplicates == "drop")
        prediction = study.predict(situations, config)
        if not self.json:
            _say_left_out({str(row["holdout"]) for row in prediction.folds}, config)
        tested = NOT_TESTED if self.without_trait else trait_test(situations, self.seed)
        tables = {
            "scores": prediction.scores,
            "folds": prediction.folds,
            "contrasts": prediction.contrasts,
        }
        tables |= tested.tables
        summary = _counts(situations) | _summary(prediction.scores) | _tests(prediction.contrasts)
        summary |= {"trait": tested.summary}
        summary |= {"limits": list(LIMITS)}
        if self.out is not None:
            provenance = _Asked(config, self.duplicates, sources_of(recordings))
            results = Results.of("recordings prediction", provenance, tables, summary)
            pictures = png({"gains": scores.gains(prediction.scores)})
            save(results, self.out, pictures, self.replace)
        if self.json:
            print_json(summary | tables)
        else:
            _show(prediction.scores)
            _show_contrasts(prediction.contrasts)
            tested.show()
        return 0

    def _config(self) -> study.Config:
        training = learned.Training(updates=self.updates)
        models = self.models or study.ALL_MODELS
        config = study.Config(self.holdout, models, training, self.seed)
        if not self.without_trait or any(name.startswith("boosting") for name in models):
            ensembles()  # a missing library is said before the slow work
        return config


@dataclass(frozen=True)
class _Asked:
    """Provenance of a prediction."""

    prediction: study.Config
    duplicates: str
    sources: list[dict[str, Any]]


def _counts(seen: Situations) -> dict[str, Any]:
    in_conflict = seen.moving & seen.conflict
    return {
        "moments": len(seen),
        "moving": int(seen.moving.sum()),
        "in_conflict": int(in_conflict.sum()),
        "drivers": len(set(seen.vehicle.tolist())),
        "drivers_in_conflict": len(set(seen.vehicle[in_conflict].tolist())),
        "chains": len(set(seen.chain.tolist())),
        "chains_in_conflict": len(set(seen.chain[in_conflict].tolist())),
        "sites": len(set(seen.site.tolist())),
    }


def _summary(rows: list[Row]) -> dict[str, Any]:
    """Return the scores by holdout, moments and model, of second halves."""
    by_holdout: dict[str, Any] = {}
    for row in rows:
        if row["part"] == "second half":
            of_moments = by_holdout.setdefault(row["holdout"], {}).setdefault(row["moments"], {})
            of_moments[row["model"]] = {
                name: row[name]
                for name in ("n", "chains", "surprise", "rmse", "displacement", "gain")
            }
    return {"second_half": by_holdout}


def _say_left_out(held: set[str], config: study.Config) -> None:
    missing = [name for name in HOLDOUTS if name not in held]
    if missing and not config.holdouts:
        say(f"not held out, because there are too few: {', '.join(missing)}")


def _show(rows: list[Row]) -> None:
    second = [row for row in rows if row["part"] == "second half"]
    for holdout, moments in dict.fromkeys((row["holdout"], row["moments"]) for row in second):
        group = [r for r in second if (r["holdout"], r["moments"]) == (holdout, moments)]
        title = f"Held-out {holdout}, {moments} moments, second halves: {group[0]['n']}"
        print_table([_line(row) for row in group], f"\n{title}, chains: {group[0]['chains']}")


def _tests(rows: list[Row]) -> dict[str, Any]:
    """Return the number of contrasts, and those that were found."""
    names = ("holdout", "moments", "model", "over", "gain")
    decided = [{name: row[name] for name in names} for row in rows if row["found"]]
    return {"contrasts_tested": len(rows), "contrasts_found": decided}


def _show_contrasts(rows: list[Row]) -> None:
    """Print the differences between models that are found, or that there are none."""
    decided = [row for row in rows if row["found"]]
    if decided:
        title = f"\nDifferences found, of {len(rows)} tested together (corrected p up to {ERROR:g})"
        print_table([_difference(row) for row in decided], title)
    elif rows:
        most = max(row["chains"] for row in rows)
        say(f"no difference between models is found: {len(rows)} tested together, corrected")
        if least_p(most) > ERROR:
            say(
                f"with {most} independent chains none can be, whatever its size; "
                f"{clusters_needed(ERROR, 1)} are needed"
            )


def _difference(row: Row) -> Row:
    interval = "" if row["low"] is None else f" ({row['low']:+.2f} to {row['high']:+.2f})"
    return {
        "held out": row["holdout"],
        "moments": row["moments"],
        "model": row["model"],
        "over": row["over"],
        "gain, nats": f"{row['gain']:+.2f}{interval}",
        "p, corrected": f"{row['p_corrected']:.3f}",
    }


def _line(row: Row) -> Row:
    metres, low, high = row["displacement"], row["gain_low"], row["gain_high"]
    interval = "" if low is None else f" ({low:+.2f} to {high:+.2f})"
    return {
        "model": row["model"],
        "surprise, nats": f"{row['surprise']:.2f}",
        "RMSE, m/s²": f"{row['rmse']:.2f}",
        "off at 3 s, m": "not seen" if metres is None else f"{metres:.2f}",
        "gain over trivial, nats": f"{row['gain']:+.2f}{interval}",
    }


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
            [_trait_line(row) for row in self.tables["trait_contrasts"]],
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
    rows, sample = trait_contrasts(models, seed), models.sample
    population = models.angle.population
    angle = direction(population.trait.mean, population.chance.sum(axis=0), _CONFIDENCE)
    spread = population.quantiles("spread", (0.025, 0.5, 0.975))
    return TraitTest(
        {"trait_models": trait_scores(models), "trait_contrasts": rows},
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


def _trait_line(row: Row) -> Row:
    return {
        "angle over": row["angle_over"],
        "gain, nats": f"{row['gain_nats']:+.3f} ({row['low']:+.3f} to {row['high']:+.3f})",
        "p": f"{row['p']:.3f}",
        "p, Holm": f"{row['p_holm']:.3f}",
        "less RMSE": f"{100 * row['rmse_gain']:+.1f} %",
        "found": "yes" if row["found"] else "no",
    }
