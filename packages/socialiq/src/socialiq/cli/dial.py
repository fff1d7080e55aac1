"""`dial`: evaluation of a trained dial."""

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from socialiq.cli import drivers
from socialiq.cli.output import Printing, listed, print_json, print_table
from socialiq.errors import UserError
from socialiq.evaluation.classes import ClassGround, driven
from socialiq.evaluation.dial import Sweep, calibrated, rollout_dial, sweep
from socialiq.evaluation.effects import DELAYS_AND_HITS
from socialiq.evaluation.exact import Metrics, Readout, optimum_of
from socialiq.learners.settings import check_seed
from socialiq.nn.actor_policy import ActorDial
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_policy import DialPolicy
from socialiq.outputs import refuse_existing
from socialiq.policies.drivers import file_of, world_for
from socialiq.social.angle import angle_difference, angle_of
from socialiq.social.dial import mixture, setting
from socialiq.storage import kind_of
from socialiq.types import Row
from socialiq.worlds import grammar
from socialiq.worlds.enumerate import Table
from socialiq.worlds.road_users import ROAD_USERS

_BY_CLASS = (
    "class_angle", "angle", "r_env", "r_vehicle", "r_vulnerable", "vehicles_delayed",
    "pedestrians_waiting", "delay", *DELAYS_AND_HITS, "collision", "arrival", "regret",
)  # fmt: skip


@dataclass(frozen=True)
class Dial(Printing):
    """Evaluate a dial at each angle: exactly in a gridworld, by episodes elsewhere.

    Each row is an angle. First it has the dial's policy at this angle: its mean sums, and in a
    gridworld its regret, the difference to the best at that angle. Then it has the mixture of two
    of the dial's policies, one drawn per episode, whose *behaviour* is at that angle: the radius is
    the length of its mean sums, and the share is relative to the longest of any policy there. Of
    episodes half of the episodes select the mixture and half measure its angle, with a 95 %
    interval.

    Example: socialiq dial crossing7 --policy run/dial_0.safetensors
    """

    world: Annotated[str, tyro.conf.Positional]
    """crossing5, crossing7, crosswalk7, intersection, merge, roundabout, ..., with a dial of
    continuous actions intersection,control=continuous; or an environment: a Gymnasium id, MODULE:ID
    or MODULE:FUNCTION."""
    policy: Path
    """Dial file, of `socialiq train dial`, or `driver`, which ships; where actions are continuous,
    of `train sac` or `iq-learn` with --set dial=true."""
    every: int = 5
    """Degrees between the rows, of a dial of two angles between those of each. In a gridworld the
    summary has two mean regrets: that of the rows, mean_regret_every_N, and that of every degree,
    mean_regret_every_1."""
    soft: bool = False
    """Select actions stochastically, from softmax(Q/τ), instead of greedily."""
    episodes: int = 500
    """Episodes of each angle where it is not exact."""
    seed: int = 0
    """Seed of the first episode there, and of the bootstrap."""
    calibrated: Path | None = None
    """Dial file to write, which answers each angle with the best of the policies of the rows at
    that angle; must not exist. Of discrete actions alone."""
    allow_code: bool = False
    """Import the environment's module: its author's code runs with your rights."""

    def run(self) -> int:
        """Query, evaluate, print."""
        if self.calibrated:
            refuse_existing(self.calibrated)
        if self.every < 1:
            raise UserError(f"--every {self.every}: give whole degrees, 1 or more")
        world: Any = drivers.world_of(grammar.parse(self._shown), self.allow_code)
        kind = kind_of(self._file)
        shown = world
        if world.action_size:
            if self.calibrated:
                raise UserError("--calibrated is of dials of discrete actions: leave it out")
            dial = ActorDial.load(self._file)
            rows, summary, _ = self.rolled(dial, world)
        else:
            if kind == ClassDial.KIND and (world.is_exact or world.walks):
                return self._by_class(world)
            if kind == ActorDial.KIND:
                raise UserError(
                    f"{self.policy} has continuous actions: choose intersection,control=continuous "
                    "or control=steering"
                )
            if kind == ClassDial.KIND:  # vehicles are the one class here
                dial = ClassDial.load(self._file).of_class(0.0)
            else:
                dial = DialPolicy.load(self._file)
            if world.is_exact:
                shown = drivers.gridworld_of(self.world, dial)
                rows, summary, evaluated = self.exact(dial, shown)
            else:
                rows, summary, evaluated = self.rolled(dial, world)
            if self.calibrated:
                calibrated(dial, evaluated).save(self.calibrated, replace=False)
        drivers.complain_if_it_stands(str(self.policy), dial, drivers.observed(shown, dial))
        summary = {"world": self.world, "policy": str(self.policy)} | summary
        if self.json:
            print_json(summary | {"angles": rows})
        else:
            print_table(rows, "angles in degrees; an empty cell: no mixture has that angle")
            print_table(listed(summary))
        return 0

    @property
    def _file(self) -> Path:
        """The dial's file."""
        return Path(file_of(str(self.policy)))

    @property
    def _shown(self) -> str:
        """The world as the dial observes it."""
        return world_for(self.world, [str(self.policy)])

    def _by_class(self, world: Any) -> int:
        """Evaluate a dial of two angles at each pair of them: exactly, or on a road by episodes."""
        if self.calibrated:
            raise UserError("--calibrated is of one angle: `socialiq turn --class-angle` first")
        dial = ClassDial.load(self._file)
        summary = Row()
        if not world.is_exact:
            check_seed(self.seed)
            if self.soft or self.episodes < 2:
                raise UserError("on a road give --episodes of 2 or more, and leave --soft out")
            drivers.refuse_misfit(str(self.policy), dial.of_class(0.0), world)
            seeds = np.arange(self.seed, self.seed + self.episodes)
            rows = list(driven(dial, world, float(self.every), seeds))
            hits = [f"{user.name}_hit" for user in ROAD_USERS if f"{user.name}_hit" in rows[0]]
            summary |= {f"worst_{name}": max(row[name] for row in rows) for name in hits}
        else:
            ground = ClassGround(drivers.gridworld_of(self.world, dial))
            rows = list(ground.sweep(dial, float(self.every), self.readout))
            regrets = [row["regret"] for row in rows]
            summary |= {"mean_regret": float(np.mean(regrets)), "worst_regret": max(regrets)}
        summary = {"world": self.world, "policy": str(self.policy)} | summary
        if self.json:
            print_json(summary | {"angles": rows})
        else:
            names = [name for name in _BY_CLASS if name in rows[0]] or list(rows[0])
            table = [{name: row[name] for name in names} for row in rows]
            print_table(table, "angles in degrees; means of an episode, exact in a gridworld")
            print_table(listed(summary))
        return 0

    @property
    def readout(self) -> Readout:
        """Action selection: greedy or soft."""
        return "soft" if self.soft else "greedy"

    def exact(self, dial: DialPolicy, table: Table) -> tuple[list[Row], Row, Sweep]:
        """Return rows, summary and evaluation in a gridworld, queried at every degree."""
        states = table.reachable_part()
        evaluated = sweep(dial, states, self.readout)
        best = optimum_of(states.world)
        regrets = evaluated.regrets(best.attainable)
        names = ("mix_first", "mix_second", "mix_share", "angle_error", "radius", "share_of_radius")
        rows = []
        for angle, metrics, regret in zip(
            evaluated.angles, evaluated.metrics, regrets, strict=True
        ):
            if (angle - evaluated.angles[0]) % self.every != 0:
                continue
            row = _queried(angle, metrics) | {"regret": float(regret)} | dict.fromkeys(names, "")
            with contextlib.suppress(UserError):  # no mixture has that angle
                mixed = setting(evaluated.points, angle)
                error = angle_difference(angle_of(*mixture(evaluated.points, mixed)), angle)
                first = evaluated.angles[mixed.first]
                second = evaluated.angles[mixed.second]
                share = mixed.radius / best.attainable.radius(angle)
                cells = (first, second, mixed.share, error, mixed.radius, share)
                row |= dict(zip(names, cells, strict=True))
            rows.append(row)
        means = {
            f"mean_regret_every_{degrees}": float(
                regrets[(np.array(evaluated.angles) - evaluated.angles[0]) % degrees == 0].mean()
            )
            for degrees in dict.fromkeys((self.every, 1))
        }
        return rows, means | _backward(evaluated), evaluated

    def rolled(self, dial: DialPolicy | ActorDial, world: Any) -> tuple[list[Row], Row, Sweep]:
        """Return rows, summary and evaluation by episodes, driven at every row's angle.

        The radius of a mixture is that of the episodes that select it.
        """
        check_seed(self.seed)
        drivers.refuse_misfit(str(self.policy), dial, world)
        angles = np.arange(dial.low, dial.high + 1e-9, self.every).tolist()
        seeds = np.arange(self.seed, self.seed + self.episodes)
        batch = world.batch(min(max(self.episodes, 1), 512))
        driven = rollout_dial(dial, batch, angles, seeds, self.readout)
        evaluated = driven.sweep
        names = ("mix_first", "mix_second", "mix_share", "radius")
        names += ("mix_angle", "mix_angle_low", "mix_angle_high")
        rows = []
        for angle, metrics, episodes in zip(
            angles, evaluated.metrics, driven.episodes, strict=True
        ):
            row = _queried(angle, metrics)
            row |= {"arrival": metrics.arrival, "collision": metrics.collision}
            if world.action_size and "off_road" in episodes:  # else the ego follows its lane
                row["off_road"] = float(episodes.off_road.mean())
            row |= dict.fromkeys(names, "")
            with contextlib.suppress(UserError):  # no mixture has that angle
                mixed, measured = driven.mixture(angle, self.seed)
                first = evaluated.angles[mixed.first]
                second = evaluated.angles[mixed.second]
                cells = (first, second, mixed.share, mixed.radius)
                cells += (measured.angle, measured.low, measured.high)
                row |= dict(zip(names, cells, strict=True))
            rows.append(row)
        summary = {"episodes": self.episodes, "seed": self.seed} | _backward(evaluated)
        return rows, summary, evaluated


def _queried(angle: float, metrics: Metrics) -> Row:
    """Return the columns of the policy of an angle."""
    return {
        "angle": angle,
        "r_env": metrics.r_env,
        "r_social": metrics.r_social,
        "behavioural_angle": metrics.angle,
    }


def _backward(evaluated: Sweep) -> Row:
    """Return the largest changes in the wrong direction."""
    back = evaluated.backward_steps()
    return {"rise_r_env": back.env, "drop_r_social": back.social}
