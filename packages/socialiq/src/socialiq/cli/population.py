"""`population`: fleets of one driver and mixed ones. `stakeholders`: who wants which angle."""

import contextlib
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from socialiq.cli.drivers import dial_of, driver_of, refuse_misfit
from socialiq.cli.output import Printing, print_json, print_table, say
from socialiq.errors import UserError
from socialiq.evaluation.measures import Episodes, by_episode
from socialiq.foreign import drawing
from socialiq.learners.settings import check_seed
from socialiq.nn.dial_policy import DialPolicy
from socialiq.outputs import check_output_folder, whole_folder
from socialiq.plotting import style
from socialiq.policies.drivers import file_of, parse, world_for
from socialiq.population import fleet
from socialiq.population import stakeholders as room
from socialiq.results_folder import as_csv, versions
from socialiq.storage import is_file, write_atomically, write_json
from socialiq.to_json import rounded
from socialiq.types import Policy, Row
from socialiq.worlds import catalogue, grammar
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.registry import make_fleet


@dataclass(frozen=True)
class Population(Printing):
    """Drive fleets of dials through one junction: what if everybody had this angle?

    Prints for each angle what becomes of a fleet of it; then for each pair of angles what few
    invaders get more than the residents, and which angles no other invades. With 95 % intervals.

    Example: socialiq population intersection --policy dial.safetensors --angle 0 45 90 --agents 8
    """

    world: Annotated[str, tyro.conf.Positional] = "intersection"
    """intersection, merge, roundabout or two_way, with options as `socialiq worlds` lists them."""
    _: KW_ONLY
    policy: Annotated[tuple[str, ...], tyro.conf.UseAppendAction]
    """A dial, which is a fleet at each angle, or another driver; one --policy for each."""
    angle: tuple[float, ...] = ()
    """Angles of the fleets, in degrees; by default 0, 15, ..., 90."""
    agents: int | None = None
    """Controlled vehicles, of 2 to 16; by default as the world says, else 8."""
    invaders: int = 1
    """Of these, vehicles of another angle than the residents."""
    spawn_probability: float | None = None
    """Chance in a second that a rule-bound vehicle enters the intersection, by default 0.6; 0: the
    fleet alone. Elsewhere the agents take the places of some of the road's vehicles."""
    duration: float | None = None
    """Seconds after which an agent is out of time; the clock of a dial counts to it. By default 30
    at the intersection, elsewhere the road's own."""
    episodes: int = 500
    """Episodes of each fleet; the same ones for all."""
    seed: int = 0
    """Seed of the first episode, and of the places of invaders."""
    out: Path | None = None
    """Folder to make: fleets.csv, invasions.csv, episodes.csv, population.json, population.png."""

    def run(self) -> int:
        """Drive, print, write the folder."""
        check_seed(self.seed)
        for name, least in (("episodes", 2), ("invaders", 1)):
            if getattr(self, name) < least:
                raise UserError(f"--{name} {getattr(self, name)}: give {least} or more")
        if self.out:
            check_output_folder(self.out)
            drawing()
        if not self.policy:
            raise UserError("no driver is named: add --policy DRIVER")
        world = self.road()
        if self.invaders >= world.agents:
            raise UserError(f"--invaders {self.invaders} leave no resident: add --agents")
        seeds = np.arange(self.seed, self.seed + self.episodes)
        with contextlib.ExitStack() as closing:
            drivers = self.drivers(world, closing)
            return self.measured(world, drivers, seeds)

    def measured(
        self, world: RoadWorld, drivers: Mapping[float | str, Policy], seeds: np.ndarray
    ) -> int:
        """Drive the fleets, print, write the folder.

        Args:
            world: The road with its agents.
            drivers: Driver of each fleet by its label: degrees of a dial, or the driver's name.
            seeds: Seed of each episode.

        Returns:
            The exit status 0.
        """
        angles = tuple(drivers)
        uniform = fleet.uniform_fleets(world, drivers, seeds)
        fleets = [{"angle": angle, **fleet.summary(group, 0)} for angle, group in uniform.items()]
        say(f"{len(angles)} fleets, and {len(angles) * (len(angles) - 1)} with invaders")
        invaders = fleet.invasions(world, drivers, uniform, seeds, self.invaders, self.seed)
        invasions = list(invaders)
        policy = self.policy[0] if len(self.policy) == 1 else list(self.policy)
        result = {
            "world": world.name, "policy": policy, "agents": world.agents,
            "invaders": self.invaders, "duration": world.options.duration,
            "spawn_probability": getattr(world.options, "spawn_probability", None),
            "episodes": self.episodes, "seed": self.seed, "fleets": fleets, "invasions": invasions,
        }  # fmt: skip
        if self.out:
            with whole_folder(self.out) as folder:
                for name, rows in (("fleets", fleets), ("invasions", invasions)):
                    write_atomically(folder / f"{name}.csv", as_csv(rows))
                write_atomically(folder / "episodes.csv", as_csv(self.by_episode(uniform)))
                write_json(folder / "population.json", rounded(result | {"versions": versions()}))
                picture = style.png({"": population_figure(fleets, invasions)})[""]
                write_atomically(folder / "population.png", picture)
        if self.json:
            print_json(result)
            return 0
        print_table(
            [{name: row[name] for name in ("angle", *fleet.MEASURES)} for row in fleets],
            f"Fleets of {world.agents}, everybody at one angle; shares, and sums until the own end",
        )
        if invasions:
            print_table(fitness_table(angles, invasions), _INVASION)
        return 0

    def road(self) -> RoadWorld:
        """Return the road with its agents."""
        written = grammar.parse(world_for(self.world, self.policy))
        usual: dict[str, Any] = {"spawn_probability": 0.6, "duration": fleet.DURATION}
        usual = usual if written.name == catalogue.INTERSECTION else {}
        usual |= {"agents": _AGENTS}
        given = {name: getattr(self, name) for name in ("agents", "spawn_probability", "duration")}
        given = {name: value for name, value in given.items() if value is not None}
        for name in given.keys() & written.options.keys():
            flag = name.replace("_", "-")
            raise UserError(f"--{flag} and {name} of the world: leave one out")
        return make_fleet(written.name, **usual | written.options | given)

    def drivers(self, world: RoadWorld, closing: contextlib.ExitStack) -> dict[float | str, Policy]:
        """Return the driver of each fleet, by degrees of a dial or by its name.

        Args:
            world: The road with its agents.
            closing: Ends the processes of drivers that are code.
        """
        drivers: dict[float | str, Policy] = {}
        dials = 0
        for text in self.policy:
            driver = parse(text)
            dial = dial_of(text) if is_file(file_of(driver.spec)) and driver.angle is None else None
            if dial is None or driver.front_end:
                loaded = closing.enter_context(driver_of(text, world, seed=self.seed))
                if getattr(loaded.policy, "remembers", False):
                    raise UserError(f"{text}: drivers of fleets have no memory: leave + out")
                drivers[text] = loaded.policy
                continue
            if not isinstance(dial, DialPolicy):
                raise UserError(f"{text} is no file of a dial of discrete actions: name one")
            refuse_misfit(text, dial, world)
            dials += 1
            usual = np.arange(dial.low, dial.high + 1e-9, 15.0).tolist()
            angles = dict.fromkeys(self.angle or usual)
            if len(angles) < 2 and len(self.policy) == 1:
                raise UserError("--angle: give two or more, for residents and invaders")
            several = sum(is_file(file_of(parse(other).spec)) for other in self.policy) > 1
            for angle in angles:
                drivers[f"{text}@{angle:g}" if several else angle] = dial.at(angle)
        if self.angle and not dials:
            raise UserError("--angle is of dials: name a dial's file by --policy, or leave it out")
        return drivers

    def by_episode(self, uniform: Mapping[float | str, Episodes]) -> list[Row]:
        """Return a row for each episode of the uniform fleets, with means over their agents."""
        rows = list[Row]()
        seeds = np.arange(self.seed, self.seed + self.episodes)
        for label, group in uniform.items():
            dialled = isinstance(label, float)
            row: Row = {"policy": self.policy[0] if dialled else label}
            row |= {"angle": label if dialled else ""}
            rows += by_episode(fleet.means(group, 0), fleet.MEASURES, seeds, row)
        return rows


_AGENTS = 8  # controlled vehicles, by default

_INVASION = (
    "What an invader (row) gets more than everybody in a fleet of residents (column), r_env; * "
    "where the 95 % interval is above 0"
)


def fitness_table(angles: tuple[float | str, ...], invasions: list[Row]) -> list[Row]:
    """Return a row for each invader, with a column for each resident.

    Args:
        angles: Angles in degrees, or names of drivers, for rows and columns.
        invasions: Rows of `population.fleet.invasions`.

    Returns:
        Rows with the gain in r_env as text; * where its interval is above 0, "" without such a row.
    """
    cells = {(row["invader"], row["resident"]): row for row in invasions}
    rows = []
    for invader in angles:
        row: Row = {"invader": invader}
        for resident in angles:
            cell = cells.get((invader, resident))
            gains = cell is not None and cell["gain_low"] > 0.0
            row[_short(resident)] = (
                "" if cell is None else f"{cell['gain']:.2f}{'*' if gains else ''}"
            )
        rows.append(row)
    return rows


def _short(label: float | str) -> str:
    return label if isinstance(label, str) else f"{label:g}"


def population_figure(fleets: list[Row], invasions: list[Row]) -> Any:
    """Draw arrivals and collisions of uniform fleets, and what the best invader gains.

    Args:
        fleets: A row for each angle, with `angle` in degrees and the means of a uniform fleet.
        invasions: Rows of `population.fleet.invasions`.
    """
    figure = style.figure(9.0, 3.2)
    panels = figure.subplots(1, 3)
    angles = [row["angle"] for row in fleets]
    named = any(isinstance(angle, str) for angle in angles)
    places = [_short(angle) for angle in angles] if named else angles
    for axes, name, label in (
        (panels[0], "arrival", "vehicles that arrive, %"),
        (panels[1], "collision", "vehicles that collide, %"),
    ):
        values, low, high = (
            100 * np.array([row[f"{name}{end}"] for row in fleets]) for end in ("", "_low", "_high")
        )
        axes.errorbar(places, values, [values - low, high - values], fmt="o-")
        style.finish(axes, "", xlabel="angle of everybody, degrees", ylabel=label)
    for number, angle in enumerate(angles):
        rows = [row for row in invasions if row["invader"] == angle]
        residents = [row["resident"] for row in rows]
        residents = [_short(label) for label in residents] if named else residents
        gains = [row["gain"] for row in rows]
        label = angle if isinstance(angle, str) else f"{angle:g}°"
        panels[2].plot(residents, gains, "o-", color=f"C{number}", label=f"invader of {label}")
    panels[2].axhline(0.0, color="#6e6e6e", linewidth=0.8)
    style.finish(panels[2], "", xlabel="angle of residents, degrees", ylabel="invader gains, r_env")
    style.head(figure, "Fleets of dials at one junction", legend=True)
    return figure


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
    """Return a row for each setting.

    Args:
        episodes: Episodes with their settings.
        people: The stakeholders.
        judgement: Utilities, and shares of resamples by choice.
    """
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
    """Return a row with each utility and its interval in one cell.

    Args:
        label: Short name of the setting.
        row: Row of `utility_rows`.
        people: The stakeholders.
    """
    cells: Row = {"setting": label}
    for person in people:
        value, low, high = (row[f"{person.name}{end}"] for end in ("", "_low", "_high"))
        cells[person.name] = f"{value:.2f} ({low:.2f} to {high:.2f})"
    return cells | {name: row[name] for name in ("dominated", *room.RULES)}


def choice_rows(
    labels: list[str], worth: np.ndarray, people: tuple[room.Stakeholder, ...]
) -> list[Row]:
    """Return the choices with the declared weights, and with each weight moved.

    Args:
        labels: Short names of the settings.
        worth: Utilities, shape (setting, episode, stakeholder).
        people: The stakeholders, with the declared weights.

    Returns:
        Rows with the stakeholder whose weight is multiplied ("" in the first row), the factor, and
        the setting that each of `RULES` chooses.
    """
    declared = room.choose(worth.mean(axis=1)[None], room.weights_of(people))
    choices = [("", 1.0, {rule: int(row[0]) for rule, row in declared.items()})]
    return [
        {"weight_of": name, "times": factor}
        | {rule: labels[setting] for rule, setting in chosen.items()}
        for name, factor, chosen in (*choices, *room.moved_weights(worth, people))
    ]
