"""`stakeholders`: who wants which angle, by declared utilities of measured quantities."""

from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from socialiq.cli.output import Printing, print_json, print_table
from socialiq.errors import UserError
from socialiq.learners.settings import check_seed
from socialiq.outputs import check_output_folder, whole_folder
from socialiq.population import stakeholders as room
from socialiq.results_folder import as_csv
from socialiq.storage import write_atomically, write_json
from socialiq.to_json import rounded
from socialiq.types import Row


@dataclass(frozen=True)
class Stakeholders(Printing):
    """Compare settings of drivers by what they are worth to stakeholders that a file declares.

    Prints utilities with 95 % intervals, dominated settings, three ways to choose with the share of
    resampled episodes that agree, and the choices after a weight moved. No choice is right without
    its weights.

    Example: socialiq stakeholders my-effects/episodes.csv --utilities people.toml
    """

    episodes: Annotated[Path, tyro.conf.Positional]
    """episodes.csv of `socialiq effects --out` or `socialiq population --out`."""
    _: KW_ONLY
    utilities: Path
    """TOML: a table for each stakeholder, with weight and the utility of one unit of a quantity."""
    resamples: int = 1000
    """Bootstrap resamples of the episodes."""
    seed: int = 0
    """Seed of the resamples."""
    out: Path | None = None
    """Folder to make: utilities.csv, choices.csv, stakeholders.json."""

    def run(self) -> int:
        """Judge, print, write the folder."""
        check_seed(self.seed)
        if self.resamples < 20:
            raise UserError(f"--resamples {self.resamples}: give 20 or more, for intervals")
        if self.out:
            check_output_folder(self.out)
        people = room.read_stakeholders(self.utilities)
        episodes = room.read_episodes(self.episodes)
        worth = room.utilities(episodes, people)
        if len(worth) < 2:
            raise UserError(f"{self.episodes} has one setting: measure two or more to compare")
        judgement = room.judge(worth, room.weights_of(people), self.resamples, self.seed)
        labels = labels_of(episodes.settings)
        rows = utility_rows(episodes, people, judgement)
        choices = choice_rows(labels, worth, people)
        weights: Row = {person.name: person.weight for person in people}
        result = {"weights": weights, "settings": rows, "choices": choices}
        if self.out:
            with whole_folder(self.out) as folder:
                write_atomically(folder / "utilities.csv", as_csv(rows))
                write_atomically(folder / "choices.csv", as_csv(choices))
                write_json(folder / "stakeholders.json", rounded(result))
        if self.json:
            print_json(result)
            return 0
        print_table(
            [printed(label, row, people) for label, row in zip(labels, rows, strict=True)],
            "Utilities with 95 % intervals; dominated and choices: shares of resampled episodes",
        )
        declared, *moved = choices
        moved = [row for row in moved if any(row[rule] != declared[rule] for rule in room.RULES)]
        title = ", ".join(f"{name} {weight:g}" for name, weight in weights.items())
        print_table([declared, *moved], f"Choices with the weights {title}; rows that differ")
        return 0


def labels_of(settings: tuple[Row, ...]) -> list[str]:
    """Return a short name for each setting: a path's last part where that is enough."""
    names = {row["policy"]: Path(str(row["policy"])).stem for row in settings}
    if len({*names.values()}) < len(names):
        names = {name: str(name) for name in names}
    return [f"{names[row['policy']]} {row['angle']}".strip() for row in settings]


def utility_rows(
    episodes: room.Episodes, people: tuple[room.Stakeholder, ...], judgement: room.Judgement
) -> list[Row]:
    """Return a row for each setting."""
    rows = []
    for number, setting in enumerate(episodes.settings):
        row = dict(setting)
        for column, person in enumerate(people):
            row[person.name] = float(judgement.mean[number, column])
            row[f"{person.name}_low"] = float(judgement.low[number, column])
            row[f"{person.name}_high"] = float(judgement.high[number, column])
        row["dominated"] = float(judgement.dominated[number])
        row |= {rule: float(shares[number]) for rule, shares in judgement.chosen.items()}
        rows.append(row)
    return rows


def printed(label: str, row: Row, people: tuple[room.Stakeholder, ...]) -> Row:
    """Return a row with each utility and its interval in one cell."""
    cells: Row = {"setting": label}
    for person in people:
        value, low, high = (row[f"{person.name}{end}"] for end in ("", "_low", "_high"))
        cells[person.name] = f"{value:.2f} ({low:.2f} to {high:.2f})"
    return cells | {name: row[name] for name in ("dominated", *room.RULES)}


def choice_rows(
    labels: list[str], worth: np.ndarray, people: tuple[room.Stakeholder, ...]
) -> list[Row]:
    """Return the choices with the declared weights, and with each weight moved."""
    declared = room.choose(worth.mean(axis=1)[None], room.weights_of(people))
    choices = [("", 1.0, {rule: int(row[0]) for rule, row in declared.items()})]
    return [
        {"weight_of": name, "times": factor}
        | {rule: labels[setting] for rule, setting in chosen.items()}
        for name, factor, chosen in (*choices, *room.moved_weights(worth, people))
    ]
