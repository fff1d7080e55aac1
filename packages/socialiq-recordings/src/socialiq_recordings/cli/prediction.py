"""`data predict`: driver models on held-out drivers."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialiq.cli.output import print_json, print_table, say
from socialiq.errors import UserError
from socialiq.plotting.style import png
from socialiq.results_folder import Results, check_target, save
from socialiq.statistics.clusters import clusters_needed, least_p
from socialiq.types import Row
from socialiq_recordings.cli.files import OfDistinct, sources_of, users_used
from socialiq_recordings.prediction import learned, scores, study
from socialiq_recordings.prediction.models import ensembles
from socialiq_recordings.prediction.scores import ERROR
from socialiq_recordings.prediction.situations import Situations, situations_of
from socialiq_recordings.prediction.study import HOLDOUTS, Holdout
from socialiq_recordings.trait import models as trait
from socialiq_recordings.trait.hierarchy import direction
from socialiq_recordings.trait.models import chains_to_find_anything

LIMITS = (
    "Lights are not in recordings: a vehicle that stands at one looks like one that gives way.",
    "Routes are taken as known, and displacement is measured along them.",
    "Rows of one chain are not independent: intervals resample chains, and few chains make them "
    "rough.",
)
"""Limits of a prediction."""


@dataclass(frozen=True)
class Predict(OfDistinct):
    """Fit driver models and predict held-out drivers: next acceleration, position after 3 s.

    Example: socialiq data predict a.safetensors b.safetensors --out prediction
    """

    out: Path | None = None
    """Folder to write: scores, contrasts of models, folds, the test of angles, a figure."""
    holdout: tuple[Holdout, ...] = ()
    """Held-out things; by default all that these recordings allow."""
    models: tuple[str, ...] = ()
    """Names of models; by default all. The trivial ones are always beside them."""
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
        training = learned.Training(updates=self.updates)
        models = self.models or study.ALL_MODELS
        config = study.Config(self.holdout, models, training, self.seed)
        if not self.without_trait or any(name.startswith("boosting") for name in models):
            ensembles()  # a missing library is said before the slow work
        if self.out is not None:
            check_target(self.out, self.replace)
        recordings, identified = self.load()
        situations = situations_of(recordings, identified, self.duplicates == "drop")
        prediction = study.predict(situations, config)
        held_out = {str(row["holdout"]) for row in prediction.folds}
        missing = [name for name in HOLDOUTS if name not in held_out]
        if missing and not config.holdouts and not self.json:
            say(f"not held out, because there are too few: {', '.join(missing)}")
        tables: dict[str, list[Row]] = {
            "scores": prediction.scores,
            "folds": prediction.folds,
            "contrasts": prediction.contrasts,
        }
        tested: Row = {}
        if not self.without_trait:
            trait_tables, tested = _trait_test(situations, self.seed)
            tables |= trait_tables
        summary = _summary(situations, prediction.scores, prediction.contrasts)
        predicted = {*situations.vehicle.tolist()}
        used = [
            [track for track, vehicle in enumerate(of.tolist()) if vehicle in predicted]
            for of in identified.vehicle
        ]
        users = users_used([recording.tracks for recording in recordings], used, _UNUSED)
        tables["road_users"] = users
        summary |= {"trait": tested, "limits": list(LIMITS), "road_users": users}
        if self.out is not None:
            provenance = {
                "prediction": dataclasses.asdict(config),
                "duplicates": self.duplicates,
                "sources": sources_of(recordings),
            }
            results = Results.of("recordings prediction", provenance, tables, summary)
            pictures = png({"gains": scores.gains(prediction.scores)})
            save(results, self.out, pictures, self.replace)
        if self.json:
            print_json(summary | tables)
        else:
            _show_scores(prediction.scores)
            _show_contrasts(prediction.contrasts)
            _show_trait(tables.get("trait_contrasts", []), tested)
            print_table(users, "\nRoad users")
        return 0


def _summary(situations: Situations, rows: list[Row], contrasts: list[Row]) -> dict[str, Any]:
    """Return counts, scores of second halves by holdout, moments and model, and what was found."""
    in_conflict = situations.moving & situations.conflict
    second_half: dict[str, Any] = {}
    for row in rows:
        if row["part"] == "second half":
            of_moments = second_half.setdefault(row["holdout"], {}).setdefault(row["moments"], {})
            names = ("n", "chains", "surprise", "rmse", "displacement", "gain")
            of_moments[row["model"]] = {name: row[name] for name in names}
    names = ("holdout", "moments", "model", "over", "gain")
    return {
        "moments": len(situations),
        "moving": int(situations.moving.sum()),
        "in_conflict": int(in_conflict.sum()),
        "drivers": len(set(situations.vehicle.tolist())),
        "drivers_in_conflict": len(set(situations.vehicle[in_conflict].tolist())),
        "chains": len(set(situations.chain.tolist())),
        "chains_in_conflict": len(set(situations.chain[in_conflict].tolist())),
        "sites": len(set(situations.site.tolist())),
        "second_half": second_half,
        "contrasts_tested": len(contrasts),
        "contrasts_found": [{n: row[n] for n in names} for row in contrasts if row["found"]],
    }


def _print(rows: list[Row], names: tuple[str, ...], title: str) -> None:
    cells = [{name: "" if row[name] is None else row[name] for name in names} for row in rows]
    print_table(cells, title)


def _show_scores(rows: list[Row]) -> None:
    """Print a table of second halves for each holdout and kind of moment."""
    names = ("model", "surprise", "rmse", "displacement", "gain", "gain_low", "gain_high")
    second = [row for row in rows if row["part"] == "second half"]
    for holdout, moments in dict.fromkeys((row["holdout"], row["moments"]) for row in second):
        group = [r for r in second if (r["holdout"], r["moments"]) == (holdout, moments)]
        title = f"Held-out {holdout}, {moments} moments, second halves: {group[0]['n']}"
        _print(group, names, f"\n{title}, chains: {group[0]['chains']} (nats, m/s², m at 3 s)")


def _show_contrasts(rows: list[Row]) -> None:
    """Print the differences between models that are found, or that there are none."""
    names = ("holdout", "moments", "model", "over", "gain", "low", "high", "p_corrected")
    if significant := [row for row in rows if row["found"]]:
        title = f"\nDifferences found, of {len(rows)} tested together (corrected p up to {ERROR:g})"
        _print(significant, names, title)
    elif rows:
        most = max(row["chains"] for row in rows)
        say(f"no difference between models is found: {len(rows)} tested together, corrected")
        if least_p(most) > ERROR:
            say(
                f"with {most} independent chains none can be, whatever its size; "
                f"{clusters_needed(ERROR, 1)} are needed"
            )


_CONFIDENCE = 0.95
_UNUSED = "never on the lanelets of the map for a second"


def _trait_test(situations: Situations, seed: int) -> tuple[dict[str, list[Row]], dict[str, Any]]:
    """Infer angles from drivers' first halves and test them on their second halves."""
    try:
        models = trait.fit_models(study.choices(situations, seed), seed)
    except UserError as error:
        return {}, {"not_tested": str(error)}
    rows, sample = trait.contrasts(models, seed), models.sample
    population = models.angle.population
    angle = direction(population.trait.mean, population.chance.sum(axis=0), _CONFIDENCE)
    spread = population.quantiles("spread", (0.025, 0.5, 0.975))
    return (
        {"trait_models": trait.scores(models), "trait_contrasts": rows},
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


def _show_trait(rows: list[Row], summary: dict[str, Any]) -> None:
    """Print the contrasts, or the reason for which there are none."""
    if "not_tested" in summary:
        say(f"the angle as a trait is not tested: {summary['not_tested']}")
    if not rows:
        return
    names = ("angle_over", "gain_nats", "low", "high", "p", "p_holm", "rmse_gain", "found")
    title = "\nA driver's angle from its first half, on its second"
    counts = f"{summary['decisions']} decisions, {summary['drivers']} drivers"
    _print(rows, names, f"{title}: {counts}, {summary['chains']} chains")
    if summary["chains"] < summary["chains_needed"]:
        say(
            f"not enough data: with {summary['chains']} independent chains no gain can be found "
            f"after correction, whatever its size; {summary['chains_needed']} are needed"
        )
