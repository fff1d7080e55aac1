"""`data predict`: driver models on held-out drivers."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialiq.cli.output import print_json, print_table, say
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
    """Folder to write: scores, contrasts of models, folds, a figure."""
    holdout: tuple[Holdout, ...] = ()
    """Held-out things; by default all that these recordings allow."""
    models: tuple[str, ...] = ()
    """Names of models; by default all. The trivial ones are always beside them."""
    updates: int = learned.Training.updates
    """Gradient steps of each learned policy."""
    seed: int = 0
    """Seed of training and resampling."""
    replace: bool = False
    """Replace earlier results in the folder."""

    def run(self) -> int:
        """Fit, predict, score, write, print."""
        training = learned.Training(updates=self.updates)
        models = self.models or study.ALL_MODELS
        config = study.Config(self.holdout, models, training, self.seed)
        if any(name.startswith("boosting") for name in models):
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
        summary = _summary(situations, prediction.scores, prediction.contrasts)
        predicted = {*situations.vehicle.tolist()}
        used = [
            [track for track, vehicle in enumerate(of.tolist()) if vehicle in predicted]
            for of in identified.vehicle
        ]
        users = users_used([recording.tracks for recording in recordings], used, _UNUSED)
        tables["road_users"] = users
        summary |= {"limits": list(LIMITS), "road_users": users}
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
                f"{clusters_needed(ERROR)} are needed"
            )


_UNUSED = "never on the lanelets of the map for a second"
