"""Fleets of dials, invaders among them, and the exact game of two drivers (9.4).

Three dials: that of Eq 4.2 and that of caused effects, which never met their like in training, and
the second one improved in fleets that it drives against itself.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.nn.dial_policy import DialPolicy
from socialiq.population import fleet, norms
from socialiq.population.crossing_game import CrossingGame, Payoffs
from socialiq.results_folder import from_csv
from socialiq.types import Policy, Row
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.registry import make_fleet
from socialiq_lab.intersection.driving import DIAL, seeds_of_blocks, shipped_dials
from socialiq_lab.intersection.training import first_dial, iteration_jobs
from socialiq_lab.jobs import Inputs, Job, ProgressCallback, write_rows
from socialiq_lab.study import Context, Findings

SHIPPED = {
    "Eq 4.2": "intersection-dial/dial.safetensors",
    "effects": "caused-effects/dial.safetensors",
}
"""Committed dials, which were trained alone among rule-bound traffic."""
SELF_PLAY = "self-play"
FLEETS = "fleets.csv"
INVASIONS = "invasions.csv"
"""Files of a job."""


@dataclass(frozen=True)
class Meeting:
    """Configuration of the fleets of one dial, or of rules, in traffic of one density."""

    agents: int
    spawn_probability: float
    seeds: tuple[int, ...]
    angles: tuple[float, ...] = ()
    rules: tuple[str, ...] = ()
    invaders: int = 0  # 0: only fleets of one driver


def meet(config: Meeting, folder: Path, inputs: Inputs, _on_progress: ProgressCallback) -> None:
    """Drive fleets of a dial at each angle or of each rule, and invaders among them.

    Args:
        config: Drivers, numbers of agents and invaders, density of traffic, and seeds.
        folder: Folder of the job, to which the rows are written.
        inputs: Folder of the job that makes the dial; empty for rules.
    """
    traffic: dict[str, Any] = {"spawn_probability": config.spawn_probability}
    world = make_fleet(agents=config.agents, duration=fleet.DURATION, **traffic)
    seeds = np.array(config.seeds)
    drivers: dict[Any, Policy] = {name: policy(name) for name in config.rules}
    for trained in inputs.values():
        dial = DialPolicy.load(trained / DIAL)
        drivers |= {angle: dial.at(angle) for angle in config.angles}
    kind = "rule" if config.rules else "angle"
    uniform = fleet.uniform_fleets(world, drivers, seeds)
    rows = [{kind: driver, **fleet.summary(group, 0)} for driver, group in uniform.items()]
    write_rows(folder / FLEETS, rows)
    if config.invaders:
        invasions = fleet.invasions(world, drivers, uniform, seeds, config.invaders, 0)
        write_rows(folder / INVASIONS, list(invasions))


def jobs(config: Any) -> list[Job]:
    """Return the jobs: train by self-play, and drive every dial in each density."""
    seeds = seeds_of_blocks(config.blocks, config.episodes)
    listed = shipped_dials(SHIPPED)
    listed += iteration_jobs(config, "dials/effects", 2, 1, 900.0, agents=config.agents)
    for number, spawn_probability in enumerate(config.spawn_probabilities):
        meeting = Meeting(config.agents, spawn_probability, seeds)
        for name, source in _dials(config):
            invades = not number and name in (*SHIPPED, f"{SELF_PLAY} {config.seeds[0]}")
            invaders = config.invaders if invades else 0
            run = replace(meeting, angles=config.angles, invaders=invaders)
            cost = 60.0 * (len(config.angles) if invaders else 1)
            listed.append(Job(f"meetings/{name}/{number}", meet, run, (source,), cost))
        run = replace(meeting, rules=config.rules)
        listed.append(Job(f"rules/{number}", meet, run, (), 30.0))
    return listed


def _dials(config: Any) -> list[tuple[str, str]]:
    """Return the name of each dial, and of the job that makes it."""
    trained = [(f"{SELF_PLAY} {seed}", f"training/{seed}") for seed in config.seeds]
    return [*((name, f"dials/{name}") for name in SHIPPED), *trained]


def compute_tables(config: Any, context: Context) -> Findings:
    """Return fleets and invasions of every dial, the exact game, and where mandates end.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        Tables `fleets`, `rules`, `invasions`, `game` and `mandates`, the summary, and a self-play
        dial.
    """
    fleets = list[Row]()
    invasions = list[Row]()
    for name, _ in _dials(config):
        for number, spawn_probability in enumerate(config.spawn_probabilities):
            folder = context.work / "meetings" / name / str(number)
            label = {"dial": name, "spawn_probability": spawn_probability}
            fleets += [label | row for row in from_csv(folder / FLEETS)]
            if (folder / INVASIONS).is_file():
                invasions += [label | row for row in from_csv(folder / INVASIONS)]
    rules = [
        {"spawn_probability": spawn_probability, **row}
        for number, spawn_probability in enumerate(config.spawn_probabilities)
        for row in from_csv(context.work / "rules" / str(number) / FLEETS)
    ]
    game = list[Row]()
    mandates = list[Row]()
    for temperature in config.temperatures:
        payoffs = CrossingGame(temperature).payoffs(config.angles)
        label = {"temperature": temperature}
        game += [label | row for row in game_rows(config, payoffs)]
        mandates += [label | row for row in mandate_rows(config, payoffs)]
    summary = {
        "stable": {
            f"{temperature:g}": [row["angle"] for row in game
                                 if row["temperature"] == temperature and row["stable"]]
            for temperature in config.temperatures
        },
    }  # fmt: skip
    tables = {
        "fleets": fleets,
        "rules": rules,
        "invasions": invasions,
        "game": game,
        "mandates": mandates,
    }
    return Findings(tables, summary, first_dial(config, context))


def game_rows(config: Any, payoffs: Payoffs) -> Iterator[Row]:
    """Yield the payoff of an angle among its like, and the best invader's gain.

    Args:
        config: Configuration of the study, whose angles have two or more values.
        payoffs: Expectations for each pair of angles.

    Yields:
        A row for each angle.
    """
    fitness = norms.invasion_fitness(payoffs.r_env)
    stable = norms.stable_angles(payoffs.r_env)
    for number, angle in enumerate(config.angles):
        others = [row for row in range(len(config.angles)) if row != number]
        best = max(others, key=lambda row: fitness[row, number])
        yield {
            "angle": angle,
            "own": float(payoffs.r_env[number, number]),
            "collision": float(payoffs.collision[number, number]),
            "steps": float(payoffs.steps[number, number]),
            "best_invader": config.angles[best],
            "gain": float(fitness[best, number]),
            "stable": bool(stable[number]),
        }


def mandate_rows(config: Any, payoffs: Payoffs) -> Iterator[Row]:
    """Yield where each mandated minimum ends, by the share of the drivers that obey.

    Args:
        config: Configuration of the study; `minima`, `obeyed` and `angles` are read.
        payoffs: Expectations for each pair of angles.

    Yields:
        A row for each minimum and share; everybody obeys a minimum of 0.
    """
    for minimum in config.minima:
        for obeyed in config.obeyed if minimum else (1.0,):
            rest = norms.mandate(payoffs.r_env, config.angles, minimum, obeyed)
            shares = rest.shares.sum(axis=0)
            angles = (
                f"{angle:g}: {share:.0%}"
                for angle, share in zip(config.angles, shares, strict=True)
                if share > 0.005
            )
            yield {
                "minimum": minimum,
                "obeyed": obeyed,
                "mean": float(shares @ payoffs.r_env @ shares),
                "obeyers": float(rest.payoffs[0]),
                "others": float(rest.payoffs[1]) if obeyed < 1.0 else "",
                "collision": float(shares @ payoffs.collision @ shares),
                "angles": "; ".join(angles),
            }
