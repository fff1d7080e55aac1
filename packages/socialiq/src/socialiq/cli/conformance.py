"""`conformance`: comparison of the compiled roads with highway-env."""

import dataclasses
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from socialiq.cli.drivers import driver_of
from socialiq.cli.output import Display, Printing, listed, print_table
from socialiq.errors import UserError
from socialiq.learners.callbacks import Clock
from socialiq.worlds.grammar import road_of
from socialiq.worlds.highway import PORTABLE
from socialiq.worlds.highway.kinds import kind_with, parts_of
from socialiq.worlds.intersection.options import (
    MULTI_AGENT,
    Options,
)

_COUNTS = ("episodes", "steps", "off_road")
_DEVIATIONS = {"max_deviation", "max_observation_deviation", "max_reward_deviation"}


@dataclass(frozen=True)
class Conformance(Printing):
    """Compare the compiled roads with the real highway-env, decision by decision.

    Exit status 1 if they differ.

    Example: socialiq conformance --episodes 40 --seed 7 --population thesis
    """

    scene: Literal["intersection", "merge", "roundabout", "two_way"] = "intersection"
    """Road to compare; other options of traffic, agents and drivers are of the intersection."""
    episodes: int = 20
    """Episodes to compare."""
    driver: str = ""
    """Driver: a rule, a policy of the atlas or a policy file; by default go, idle, wait and
    random in turn. Not with continuous actions, which are drawn."""
    seed: int = 0
    """Seed of the first episode; the others follow."""
    population: str = "highway_env"
    """Other drivers: highway_env or thesis."""
    connected: bool = False
    """Drivers look beyond the end of their lane, as in intersection-v2."""
    actions: Literal["discrete", "continuous", "continuous_steering"] = "discrete"
    """The ego's actions: of continuous ones, acceleration alone or with steering."""
    agents: int = 1
    """Controlled vehicles: from 2 to 4 as in intersection-multi-agent-v0 and -v1, with --connected
    as in -v2, with random actions."""
    offroad_terminal: bool = False
    """With continuous actions: end an episode where the ego is off the road, on both sides."""
    default_numpy: bool = False
    """Use NumPy's AVX-512 routines, with which highway-env itself differs by an ulp. Tolerates
    deviations, but no discrete difference."""

    def run(self) -> int:
        """Compare, by default in a process with portable arithmetic."""
        if self.episodes < 1:
            raise UserError(f"episodes must be at least 1, got {self.episodes}")
        for name in ("driver", "population", "connected", "agents", "offroad_terminal"):
            is_given = getattr(self, name) != getattr(Conformance, name)
            if is_given and self.scene != "intersection":
                option = name.replace("_", "-")
                raise UserError(
                    f"--{option} is of the intersection: leave it out with {self.scene}"
                )
        if self.offroad_terminal and self.actions == "discrete":
            raise UserError("--offroad-terminal is of continuous actions: add --actions")
        if not 1 <= self.agents <= 4:
            raise UserError(f"--agents takes 1 to 4, got {self.agents}")
        traffic: dict[str, Any] = {"population": self.population, "connected_lanes": self.connected}
        if self.agents > 1:
            traffic |= {"agents": self.agents, **MULTI_AGENT}
        if self.actions != "discrete":
            traffic |= {"actions": self.actions, "offroad_terminal": self.offroad_terminal}
        options = kind_with(Options, parts_of(traffic))(**traffic)
        if not self.default_numpy and os.environ | PORTABLE != dict(os.environ):
            command = [sys.executable, "-m", "socialiq", "conformance"]
            for name, value in {**dataclasses.asdict(self), "json": self.json}.items():
                option = f"--{name.replace('_', '-')}"
                command += [option] if value is True else [option, str(value)] if value else []
            return subprocess.run(command, env=os.environ | PORTABLE, check=False).returncode
        deviations = self.compare(options)
        if self.json:
            print(json.dumps(deviations))  # to the last bit, unlike other commands, which round
        else:
            values = {name: str(value) for name, value in deviations.items()}
            print_table(listed(values, "compared"))
        forgiven = set(_COUNTS) | (_DEVIATIONS if self.default_numpy else set())
        return int(any(value > 0 for name, value in deviations.items() if name not in forgiven))

    def compare(self, options: Options) -> dict[str, float]:
        """Return totals and largest deviations over the episodes."""
        from socialiq.worlds import conformance

        if self.scene == "intersection":
            driver = None
            if self.driver:
                driver = driver_of(self.driver, road_of(options), seed=self.seed).policy
            compared = conformance.compare_intersection(options, self.episodes, self.seed, driver)
        else:
            how = self.episodes, self.seed, self.actions
            compared = conformance.compare_scene(self.scene, *how)
        rows = []
        with Display() as display:
            report = display.stage("conformance")
            clock = Clock(0, self.episodes, 1)
            for episode in compared:
                rows.append(episode)
                progress = clock.report(len(rows), {}, {}, ())
                report(progress._replace(unit="episodes"))
        columns = {name: [getattr(row, name) for row in rows] for name in rows[0]._fields}
        return {
            "episodes": len(rows),
            "steps": int(np.sum(columns["steps"])),
            "off_road": int(np.sum(columns["off_road"])),
            "discrete_differences": int(np.sum(columns["discrete_differences"])),
            **{name: float(np.max(columns[name])) for name in sorted(_DEVIATIONS)},
        }
