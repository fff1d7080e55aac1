"""`effects`: effects of drivers on others, measured by the same episodes without them."""

import contextlib
import functools
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import tyro

from socialiq.cli.drivers import (
    OnRoads,
    dial_of,
    driver_in,
    driver_of,
    gridworld_of,
    with_fallback,
    with_one_ego,
)
from socialiq.cli.output import Printing, Result, say
from socialiq.cli.words import refuse_unused
from socialiq.errors import UserError, one_of
from socialiq.evaluation import measures
from socialiq.evaluation.counterfactual import BesideWithoutEgo
from socialiq.evaluation.effects import (
    DELAYS_AND_HITS,
    Begun,
    expected_delay,
    measure,
    measuring,
    summary,
    sums_in,
)
from socialiq.evaluation.exact import action_table, evaluate_exactly
from socialiq.evaluation.measures import Episodes, by_episode
from socialiq.evaluation.shield import shielded
from socialiq.evaluation.simulate import Watched
from socialiq.foreign import drawing
from socialiq.learners.settings import check_seed
from socialiq.outputs import check_output_folder, whole_folder
from socialiq.plotting import style
from socialiq.policies.drivers import parse, schema_of, shipped_at, showing
from socialiq.policies.interface import Loaded
from socialiq.policies.load import name_of
from socialiq.results_folder import as_csv, versions
from socialiq.storage import write_atomically, write_json
from socialiq.to_json import rounded
from socialiq.types import Policy, Row
from socialiq.worlds import SUMO_IDS, UNSEEN
from socialiq.worlds.catalogue import GRIDS, INTERSECTION, NAMES
from socialiq.worlds.environment import is_environment, make_environment
from socialiq.worlds.files import names_file
from socialiq.worlds.grammar import Written
from socialiq.worlds.highway.effects import RELATIONS, AfterTimeout, EffectOptions
from socialiq.worlds.registry import make, make_grid
from socialiq.worlds.road_users import ROAD_USERS

Placed = tuple[gymnasium.Env[Any, Any], Policy]
_USUAL = EffectOptions().definition["units"]  # options of the measure, with their defaults
FEW = 50
"""Episodes below which intervals of skewed effects hold the mean clearly less often than said."""
PRINTED = (
    "policy", "angle", "fallback", "r_env", "delay", "delay_low", "delay_high", "delay_vehicle",
    *(f"{what}_{user.sumo.name}" for what in ("delay", "waiting") for user in ROAD_USERS),
    "braking", "gap_below_1_s",
    "collision", "arrival", *DELAYS_AND_HITS,
    "not_caused_of_charged", "missed_of_caused", "gained_of_credited",
)  # fmt: skip


@dataclass(frozen=True)
class EffectsOf(Printing):
    """Measure what drivers cause: metres that others lose, hard brakings, close encounters.

    Every episode is driven again without the ego, with the same later traffic, to a common end.
    Beside it stands how often Eq 4.2 is wrong on these episodes. Means have 95 % intervals.

    Example: socialiq effects intersection --policy dial.safetensors --angle 0 45 90 --policy wait
    """

    world: Annotated[str, tyro.conf.Positional]
    """intersection, intersection-crosswalk, merge, roundabout, another road of highway-env, a file
    of `socialiq data world`, sumo, sumo-row, a network of SUMO (.net.xml), or a gridworld, whose
    delay is exact, in cells: crossing5, crossing7 or crosswalk7; or an environment with a
    `without_ego`."""
    _: KW_ONLY
    policy: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """A driver: a rule, a policy of the atlas, or a file, as `socialiq audit` takes them; by
    default on a road the driver that ships, at each --angle or at 45 degrees."""
    angle: tuple[float, ...] = ()
    """Angles of dials, in degrees; by default 0, 15, ..., 90."""
    episodes: int = 1000
    """Episodes of each driver; the same ones for all."""
    seed: int = 0
    """Seed of the first episode."""
    horizon: float = 0.0
    """Seconds from the reset to the common end; by default that of a file that rewards effects,
    else 1.5 times the duration of an episode."""
    tow_after: float = 5.0
    """Seconds after which wrecks are removed, with and without the ego; 0 leaves them."""
    after_timeout: AfterTimeout = "traffic"
    """An ego out of time drives on as traffic, or is removed."""
    road: tyro.conf.OmitArgPrefixes[OnRoads] = field(default_factory=OnRoads)
    out: Path | None = None
    """Folder to make: effects.csv, episodes.csv, effects.json, effects.png."""
    allow_code: bool = False
    """Run a policy that is a program or Python code."""

    def result(self) -> Result:
        """Drive, write the folder."""
        check_seed(self.seed)
        written = self.road.written(self.world, self._named)
        simulated = not written.is_built and is_environment(written.name)
        if not (written.is_built or simulated or names_file(written.name)):
            one_of("world", written.name, (*NAMES, *SUMO_IDS))
        if self.angle and all(angle is None for _, angle in self.drivers()):
            raise UserError("--angle is of dials: name a dial's file by --policy, or leave it out")
        if self.out:
            check_output_folder(self.out)
        episodes: list[Row] = []
        driven = self.simulated if simulated else self.driven
        rows, about = self.exact() if written.name in GRIDS else driven(written, episodes)
        if about.get("episodes", FEW) < FEW:
            say(f"below {FEW} episodes the 95 % intervals are too narrow")
        on_road = {name: value for name, value in vars(self.road).items() if value}
        result = {"world": self.world, **about, **on_road, **self.road.options, "drivers": rows}
        if self.out:
            with whole_folder(self.out) as folder:
                write_atomically(folder / "effects.csv", as_csv(rows))
                write_json(folder / "effects.json", rounded(result | {"versions": versions()}))
                if episodes:
                    write_atomically(folder / "episodes.csv", as_csv(episodes))
                if episodes and not simulated:
                    write_atomically(
                        folder / "effects.png", style.png({"": effects_figure(rows)})[""]
                    )
        names = [name for name in PRINTED if name in rows[0]]
        short = {name: Path(name).name for name in map(name_of, self._named)}
        if len({*short.values()}) == len(short):  # paths would be broken over lines
            rows = [row | {"policy": short[row["policy"]]} for row in rows]
        short_rows = [{name: row[name] for name in names} for row in rows]
        return Result(result, short_rows, _HEADING, rows, ("policy", "angle"))

    def driven(self, written: Written, episodes: list[Row]) -> tuple[list[Row], Row]:
        """Return a row for each driver on a road, and what was chosen; append episodes."""
        options = self.measured()
        # A file that rewards effects has its own options of the measure.
        changes = {name: option for name, option in options.items() if option != _USUAL[name]}
        plain: Any = with_one_ego(written)
        world: Any = measuring(plain, **changes)
        options = {name: getattr(world.effects, name) for name in options}
        seeds = np.arange(self.seed, self.seed + self.episodes)
        rows = []
        begun = defaultdict[str, Begun](dict)  # by schema of observations
        with contextlib.ExitStack() as closing:
            # What can't work is refused before the first driver drives.
            world.batch(1)
            if self.out:
                drawing()
            opened = list[tuple[str, float | None, Any, Loaded]]()
            for name, angle in self.drivers():
                # Each driver is shown what it observes.
                road: Any = with_one_ego(self.road.written(self.world, [name]))
                watched = measuring(road, **changes)
                loaded = closing.enter_context(driver_of(name, watched, angle, self.allow_code))
                opened.append((name, angle, watched, loaded))
            for name, angle, watched, loaded in opened:
                read = functools.partial(driver_of, world=watched)
                driver = with_fallback(self.road.fallback, name, loaded, read)
                start = begun[watched.schema]
                effects = measure(watched, driver, seeds, start, shield=self.road.shield)
                row: Row = {"policy": name_of(name), "angle": "" if angle is None else angle}
                row |= {"fallback": driver.share} if isinstance(driver, Watched) else {}
                rows.append(row | summary(effects))
                episodes += by_episode(effects, _BY_EPISODE, seeds, row)
                say(f"{row['policy']} {row['angle']}: delay {rows[-1]['delay']:.1f} m")
        return rows, {"episodes": self.episodes, "seed": self.seed, **options}

    def measured(self) -> dict[str, Any]:
        """Return the options of the measure."""
        if self.episodes < 2:
            raise UserError(f"--episodes {self.episodes}: give 2 or more, for intervals")
        return {name: getattr(self, name) for name in _USUAL}

    @contextlib.contextmanager
    def in_sumo(self, name: str, angle: float | None, options: Row) -> Iterator[Placed]:
        """Yield SUMO with the clock that a driver takes, and the driver."""
        written = self.road.written(self.world, [name])
        layout = showing(make(INTERSECTION), schema_of(parse(name).spec))
        read = functools.partial(driver_of, world=layout)
        with driver_of(name, layout, angle, self.allow_code) as loaded:
            driver = with_fallback(self.road.fallback, name, loaded, read)
            length = getattr(driver, "n_features", None) or loaded.record.interface.n_features
            clock = length > layout.n_features
            settings = {"clock": clock, **options, **written.options}
            yield make_environment(written.name, settings), driver

    @contextlib.contextmanager
    def in_own(self, name: str, angle: float | None, _: Row) -> Iterator[Placed]:
        """Yield an environment beside itself without the ego, and a driver of it."""
        written = self.road.written(self.world, [name])
        how = {"allow_code": self.allow_code, "needs_pair": True, "continuous": True}
        env = BesideWithoutEgo(make_environment(*written, **how))
        read = functools.partial(driver_in, env, written=written)
        with driver_in(env, name, written, angle, self.allow_code) as loaded:
            yield env, with_fallback(self.road.fallback, name, loaded, read)

    def simulated(self, written: Written, episodes: list[Row]) -> tuple[list[Row], Row]:
        """Return a row for each driver in SUMO or an own environment; append episodes."""
        options = self.measured() if written.in_sumo else {}
        if not options:
            refuse_unused(self, (*_USUAL,), "a road as the world")
        placed = self.in_sumo if options else self.in_own
        rows = list[Row]()
        if options and written.options.get("observation") != "route":
            say(UNSEEN)
        seeds = np.arange(self.seed, self.seed + self.episodes)
        for name, angle in self.drivers():
            with placed(name, angle, options) as (env, driver):
                sums = sums_in(env, shielded(driver, env.unwrapped, self.road.shield), seeds)
            row: Row = {"policy": name_of(name), "angle": "" if angle is None else angle}
            row |= {"fallback": driver.share} if isinstance(driver, Watched) else {}
            episodes += by_episode(sums, sums, seeds, row)
            row |= {"episodes": self.episodes}
            endings = Episodes(ending=sums.pop("ending"))
            row |= measures.summary(sums, sums)
            row |= measures.summary(endings, ("arrival", "collision"))
            rows.append(row)
            say(f"{row['policy']} {row['angle']}: delay {row['delay']:.1f}")
        return rows, {"episodes": self.episodes, "seed": self.seed, **options}

    def exact(self) -> tuple[list[Row], Row]:
        """Return the expected cells that each driver costs others in a gridworld."""
        refuse_unused(self, ("episodes", "seed", *_USUAL), "a road as the world")
        plain = make_grid(self.world)
        rows = list[Row]()
        for name, angle in self.drivers():
            with driver_of(name, plain, angle, self.allow_code) as loaded:
                table = gridworld_of(self.world, loaded.record.interface)
                read = functools.partial(driver_of, world=table.world)
                driver = with_fallback(self.road.fallback, name, loaded, read)
                chances = action_table(driver, table, "greedy")
            metrics = evaluate_exactly(table, chances)
            row: Row = {"policy": name_of(name), "angle": "" if angle is None else angle}
            row |= {"r_env": metrics.r_env, "r_social": metrics.r_social}
            row |= {"delay": expected_delay(table, chances), "collision": metrics.collision}
            rows.append(row | {"arrival": metrics.arrival})
        return rows, {"unit": "cells"}

    @property
    def _named(self) -> Sequence[str]:
        """The drivers, or the one that ships."""
        return self.policy or shipped_at(self.world, self.angle)

    def drivers(self) -> Iterator[tuple[str, float | None]]:
        """Yield name and angle of every driver; a dial is one at each angle."""
        for name in self._named:
            dial = dial_of(name, self.world)
            if dial is None:
                yield name, None
                continue
            driver = parse(name)
            if driver.angle is not None:
                for angle in self.angle if self.policy else ():
                    driver.at(angle)
                yield name, driver.angle
                continue
            for angle in self.angle or np.arange(dial.low, dial.high + 1e-9, 15.0).tolist():
                yield name, angle


_HEADING = (
    "delay: metres (cells) that others lose in an episode; braking: hard brakings caused; gap: "
    "post-encroachment time; of_charged, of_caused, of_credited: shares of what Eq 4.2 charges, "
    "of what is caused, and of what it credits"
)


_BY_EPISODE = (
    "r_env", "r_caused", "r_eq_4_2", "ending", *(f"delay_{name}" for name in RELATIONS), "braking",
    "gap", "helped", "harmed",
)  # fmt: skip


def effects_figure(rows: list[Row]) -> Any:
    """Draw delay, hard brakings and close encounters: dials over the angle, others as lines."""
    figure = style.figure(9.0, 3.2)
    panels = figure.subplots(1, 3)
    measures = (
        ("delay", 1.0, "delay of others, m"),
        ("braking", 1.0, "hard brakings caused"),
        ("gap_below_1_s", 100.0, "episodes with a gap < 1 s, %"),
    )
    names = list(dict.fromkeys(row["policy"] for row in rows))
    for axes, (measured, factor, label) in zip(panels, measures, strict=True):
        for number, name in enumerate(names):
            rows_of_policy = [row for row in rows if row["policy"] == name]
            columns = [
                [row[measured + end] * factor for row in rows_of_policy]
                for end in ("", "_low", "_high")
            ]
            values, low, high = np.array(columns)
            color = f"C{number}"
            if rows_of_policy[0]["angle"] == "":
                axes.axhline(values[0], color=color, linestyle="--", label=name)
                continue
            errors = np.stack([values - low, high - values])
            places = [row["angle"] for row in rows_of_policy]
            axes.errorbar(places, values, errors, fmt="o-", color=color, label=name)
        axes.axhline(0.0, color="#6e6e6e", linewidth=0.8)
        style.finish(axes, "", xlabel="angle of a dial, degrees", ylabel=label)
    style.head(figure, "Effects of drivers on others", legend=True)
    return figure
