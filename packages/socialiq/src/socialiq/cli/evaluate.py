"""`evaluate`: metrics of saved policies."""

import functools
import math
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro

from socialiq.cli import drivers
from socialiq.cli.output import Display, Printing, Result, listed, print_table, say
from socialiq.demonstrations.mixture import concatenate
from socialiq.errors import UserError
from socialiq.evaluation import context, exact, parts
from socialiq.evaluation.episodes import (
    AT_INTERSECTION,
    SIDE_BY_SIDE,
    episodes_of,
    policy_row,
)
from socialiq.evaluation.measures import DECISION, Episodes, Quantity, compared, joined
from socialiq.evaluation.rollout import Rollout, rollout_env, rollout_table
from socialiq.evaluation.shield import shielded
from socialiq.evaluation.simulate import Watched
from socialiq.learners.settings import check_seed
from socialiq.policies.card import trained_angle
from socialiq.policies.drivers import RANDOM, parse, shipped_at, world_for
from socialiq.policies.interface import Record
from socialiq.policies.load import name_of
from socialiq.social.angle import angle_of, check_angle
from socialiq.social.angle_rule import load_rule
from socialiq.types import RewardPair, Row
from socialiq.worlds import IDS, OLD_IDS, SCENE_IDS, SUMO_IDS, UNSEEN, environment, registry
from socialiq.worlds.catalogue import GRIDS, INTERSECTION
from socialiq.worlds.files import is_world_file, refuse_file
from socialiq.worlds.grammar import Written

TIMED = (*SCENE_IDS, *(SCENE_IDS | SUMO_IDS | OLD_IDS).values(), IDS["intersection"])
"""Roads of highway-env and worlds in SUMO, which show the time where a policy takes it."""


class Measured(NamedTuple):
    """Measured quantities of a policy.

    Attributes:
        row: Numbers by name.
        target: Angle in degrees that it was trained for; None if it is not known.
        totals: Sums of both rewards in each episode; where it is exact, the mean twice.
    """

    row: dict[str, Any]
    target: float | None
    totals: RewardPair


@dataclass(frozen=True)
class Evaluate(Printing):
    """Measure saved policies: exactly in a gridworld, or by rollouts anywhere.

    The score at --angle, cos α r_env + sin α r_social, has a 95 % interval. Several policies drive
    the same episodes: the best one is marked, and `below_best` is the mean paired difference to it.
    They are also pooled: the angle is that of the mean totals, if all were trained for one angle.

    A policy may also be a Stable-Baselines3 zip, an ONNX file, process:COMMAND LINE or
    python:FILE.py:NAME, as for `socialiq audit`; a dial is evaluated at --angle. A world may be
    an environment of your own too: a Gymnasium id, MODULE:ID or MODULE:FUNCTION.

    With --data there is no world: the score at --angle, by default at 0, 15, ..., 90 degrees, is
    estimated from episodes that others drove, with 95 % intervals, by fitted Q evaluation and by
    weighted importance sampling, and a line says what the data can't support.

    `random` is a policy of every world. On roads and in SUMO the driver that ships (driver@45), a
    rule-based driver (go, wait, idm, gap_3s, ...) or a policy of the atlas (expert_egoistic,
    baseline, prosocial, ...) may be named too. Each policy is shown what it observes.

    Example: socialiq evaluate run/policy_angle45.safetensors --world crossing7 --angle 45
    """

    policies: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """Policy files, of `socialiq train`; by default on a road the driver that ships, at --angle or
    45 degrees."""
    world: str = "crossing7"
    """crossing5, crossing7, crosswalk7, intersection, intersection-crosswalk (at a class angle:
    -crosswalk-60), intersection-continuous,
    intersection-continuous-steering (with -offroad: leaving the road ends an episode), sumo,
    sumo-row, a network of SUMO (.net.xml), or an environment."""
    data: Path | None = None
    """Demonstrations file with both rewards, in the place of a world."""
    angle: float | None = None
    """Angle in degrees of the score, of a dial, and of the regret in a gridworld; by default the
    angle that each policy was trained for, and 0 where that is not known."""
    angle_rule: Path | None = None
    """TOML file of a rule of the angle: the decision loss at it is measured, in a gridworld."""
    soft: bool = False
    """Select actions stochastically, from softmax(Q/τ), instead of greedily."""
    episodes: int = 0
    """Number of episodes to roll out; 0 evaluates exactly, which only gridworlds allow."""
    seed: int = 0
    """Seed of the rollouts and the bootstrap."""
    road: tyro.conf.OmitArgPrefixes[drivers.OnRoads] = field(default_factory=drivers.OnRoads)
    processes: int = 0
    """Processes among which episodes of a road or of an environment are split, by seed; by default
    this one plays all."""
    allow_code: bool = False
    """Import the modules that are named: their authors' code runs with your rights."""

    def show(
        self, result: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], title: str = ""
    ) -> int:
        """Print a result, of several policies with what is pooled; return the exit status 0.

        Args:
            result: The result.
            rows: The result as rows of equal keys.
            title: Line above the table; "" for none.
        """
        if "data" in result and not self.json:
            from socialiq.cli.evaluate_data import print_estimates

            print_estimates(result)
            return 0
        super().show(result, rows, title)
        if not self.json and "pooled" in result:
            pooled = {**result["pooled"]}
            why = pooled.pop("angle_not_pooled", "")
            print_table(listed(pooled, "pooled"))
            if why:
                sys.stdout.write(f"No pooled angle: {why}.\n")
        return 0

    def result(self) -> Result:
        """Evaluate."""
        check_angle(self.angle or 0.0)
        written = self.road.written(self.world, self._policies)
        is_grid = written.name in GRIDS
        if self.angle_rule is not None and (self.data or not is_grid or self.episodes):
            raise UserError(
                "--angle-rule is exact, in a gridworld without --episodes: at the intersection "
                "`socialiq audit` measures it"
            )
        if self.road.fallback and (self.soft or self.processes):
            raise UserError("--fallback goes without --soft and --processes")
        if self.data is not None:
            from socialiq.cli.evaluate_data import evaluate_data  # a network is fitted: needs JAX

            counts = {"--episodes": self.episodes, "--processes": self.processes}
            if options := [name for name, value in counts.items() if value]:
                raise UserError(f"--data rolls nothing out: leave out {', '.join(options)}")
            check_seed(self.seed)
            return evaluate_data(self, self._policies, self.data)
        rows, targets, totals = map(list, zip(*self.measured(), strict=True))
        scores = self._scores(targets, totals)
        rows = [score | row for score, row in zip(scores, rows, strict=True)]
        if len(rows) == 1:
            return Result(rows[0], listed(rows[0]))
        columns = ("policy", "score", "below_best", "r_env", "r_social", "angle", "arrival")
        columns = (*columns, "collision", "off_road", "length", "target_angle", "regret")
        table = [{"policy": name} | row for name, row in zip(self._names, rows, strict=True)]
        short = [{key: _with_interval(key, row) for key in columns if key in row} for row in table]
        numbers = {"policies": table, "pooled": pool(rows, targets)}
        title = "score: cos α r_env + sin α r_social at the angle" if scores[0] else ""
        return Result(numbers, short, title, table=table, labels=("policy",))

    def _scores(self, targets: list[float | None], totals: list[RewardPair]) -> list[Row]:
        """Return the scores of policies at one angle, or each at its own; empty where one has none.

        Args:
            targets: Angle in degrees that each policy was trained for; None if it is not known.
            totals: Sums of both rewards in each episode, of each policy.
        """
        stated = [parse(policy).at(self.angle) for policy in self._policies]
        angles = [
            target if angle is None else angle
            for angle, target in zip(stated, targets, strict=True)
        ]
        known = {angle for angle in angles if angle is not None}
        if len(known) == 1:
            return compared(totals, known.pop())
        if None in angles:
            return [{} for _ in angles]
        return [_scored(*pair) for pair in zip(totals, angles, strict=True)]

    @property
    def _names(self) -> list[str]:
        """Names of the policies in a table: of files the last part, where that tells them apart."""
        names = [name_of(policy) for policy in self._policies]
        short = [Path(name).name for name in names]
        return short if len({*short}) == len(short) else names

    def measured(self, policies: Sequence[Any] = ()) -> list[Measured]:
        """Return what is measured of each policy.

        Args:
            policies: Drivers as text, or policies; by default those of the command.
        """
        policies = policies or self._policies
        written = self.road.written(self.world, policies)
        refuse_file(written.name)
        parts.check_processes(self.processes)
        if self.processes and written.name in GRIDS:
            raise UserError(f"episodes of {self.world} are not split: leave out --processes")
        if written.name in GRIDS:
            measure = self.gridworld()
            return [measure(name) for name in policies]
        if self.episodes < 1:
            raise UserError(f"{self.world} can't be evaluated exactly: add --episodes N")
        is_road = written.is_built or is_world_file(written.name)
        on_road = self.on_road if is_road else self.environment
        # Each policy is shown what it observes.
        return [on_road(self.road.written(self.world, [name]), name) for name in policies]

    @property
    def _policies(self) -> list[Any]:
        """Drivers as text, or as objects that a function got.

        Raises:
            UserError: If there is none, and the driver that ships can't drive there.
        """
        if self.policies:
            return [str(path) if isinstance(path, Path) else path for path in self.policies]
        if self.data is not None:
            raise UserError("no policy: name at least one file that `socialiq train` wrote")
        return shipped_at(self.world, () if self.angle is None else (self.angle,))

    @property
    def _seeds(self) -> range:
        return range(self.seed, self.seed + self.episodes)

    def on_road(self, written: Written, name: Any) -> Measured:
        """Return the metrics of thesis 5.4 with intervals, and the angle.

        At the intersection there are the conflict rates too.
        """
        readout = "soft" if self.soft else "greedy"
        size = min(SIDE_BY_SIDE, self.episodes)
        shield = self.road.shield
        world = drivers.with_one_ego(written)
        settings = (name, written, self.angle, self.allow_code, self.soft, shield, size)
        with drivers.driver_of(name, world, self.angle, self.allow_code, self.seed) as loaded:
            read = functools.partial(drivers.driver_of, world=world)
            driver = drivers.with_fallback(self.road.fallback, name, loaded, read)
            if not self.processes:
                batch: Any = world.batch(size)
                seeds = np.array(self._seeds)
                policy = shielded(driver, batch, shield)
                measured = _quantities(written)
                episodes = episodes_of(batch, policy, seeds, not self.soft, measured)
            elif name == RANDOM or (self.soft and not loaded.record.soft):
                raise parts.draws_in_order(name)
            else:  # as many side by side as in one
                blocks = parts.blocks_of(self._seeds, self.processes)
                play = functools.partial(_play_road, *settings)
                with Display() as display:
                    report = display.stage("episodes")
                    episodes = joined(parts.in_parts(play, blocks, self.processes, report))
            if (dial := drivers.dial_of(name, self.world)) is not None:
                plain = registry.open_world(world_for(self.world, [name]))
                drivers.complain_if_it_stands(name, dial, drivers.observed(plain, dial))
        # With discrete actions the ego follows its lane.
        row = policy_row(name_of(name), readout, episodes, off_road=world.action_size > 0)
        method: dict[str, Any] = {"method": f"{self.episodes} episodes, seed {self.seed}"}
        method |= {"fallback": driver.share} if isinstance(driver, Watched) else {}
        row = method | {key: value for key, value in row.items() if key != "policy"}
        return Measured(row, target_of(loaded.record), episodes.totals)

    def gridworld(self) -> Callable[[Any], Measured]:
        """Return exact or sampled metrics of a policy, with regret against the exact optimum."""
        plain = registry.make_grid(self.world)
        optimum = exact.optimum_of(plain)
        rule = None if self.angle_rule is None else load_rule(self.angle_rule)

        def measure(name: Any) -> Measured:
            readout = "soft" if self.soft or name == RANDOM else "greedy"
            with drivers.driver_of(name, plain, self.angle, self.allow_code) as loaded:
                table = drivers.gridworld_of(self.world, loaded.record.interface)
                states = table.reachable_part()
                if (dial := drivers.dial_of(name, self.world)) is not None:
                    drivers.complain_if_it_stands(name, dial, states.observations())
                driven = table if self.episodes else states
                read = functools.partial(drivers.driver_of, world=table.world)
                driver = drivers.with_fallback(self.road.fallback, name, loaded, read)
                chances = exact.action_table(driver, driven, readout)
            target = target_of(loaded.record)
            angle = parse(name).at(self.angle)
            angle = (target or 0.0) if angle is None else angle
            if self.episodes:
                rollout = rollout_table(table, chances, self.episodes, self.seed)
                metrics = rollout.metrics()
                row = self.sampled(rollout)
                totals = rollout.transitions.totals()
            else:
                metrics = exact.evaluate_exactly(states, chances)
                row = {"method": "exact", **metrics._asdict()}
                totals = RewardPair(np.full(2, metrics.r_env), np.full(2, metrics.r_social))
                if rule is not None:
                    lost = context.evaluate_by_rule(states, chances, rule).loss
                    row["decision_loss"] = float(lost.sum())
                    for name, loss in zip(rule.contexts, lost.tolist(), strict=True):
                        row[f"decision_loss where {name}"] = loss
            regret = optimum.regret(metrics, angle)
            row |= {"readout": readout, "target_angle": angle, "regret": regret}
            return Measured(row, target, totals)

        return measure

    def environment(self, written: Written, policy: Any) -> Measured:
        """Return metrics of a policy in an environment, played in parts if there are processes.

        In parts environment and policy must keep no memory from one episode to the next, as
        Gymnasium's `reset(seed=...)` promises.
        """
        if written.in_sumo and written.options.get("observation") != "route":
            say(UNSEEN)
        settings = (written, policy, self.angle, self.allow_code)
        settings = (*settings, self.soft, self.road)
        if not self.processes:
            played = [_play_in_environment(*settings, np.array(self._seeds))]
        elif self.soft or policy == RANDOM:
            raise parts.draws_in_order(policy)
        else:
            blocks = parts.blocks_of(self._seeds, self.processes)
            play = functools.partial(_play_in_environment, *settings)
            with Display() as display:
                played = parts.in_parts(play, blocks, self.processes, display.stage("episodes"))
        rollouts = [rollout for rollout, *_ in played]
        table = concatenate([rollout.transitions for rollout in rollouts])
        table = replace(table, source=rollouts[0].transitions.source)
        if (dial := drivers.dial_of(policy, self.world)) is not None:
            drivers.complain_if_it_stands(policy, dial, table.observation)
        speed = np.concatenate([rollout.speed for rollout in rollouts])
        counted = Counter[str]()
        for rollout in rollouts:
            counted.update(rollout.counted)
        row = self.sampled(Rollout(table, speed, counted))
        _, record, share = played[0]
        row |= {} if share is None else {"fallback": share}
        return Measured(row, target_of(record), table.totals())

    def sampled(self, rollout: Rollout) -> dict[str, Any]:
        """Return the metrics of a rollout, without quantities that are not reported."""
        metrics = rollout.metrics()._asdict().items()
        estimate = rollout.angle(self.seed)
        counted = rollout.counted.items()
        return {
            "method": f"{self.episodes} episodes, seed {self.seed}",
            **{name: value for name, value in metrics if math.isfinite(value)},
            "angle_low": estimate.low,
            "angle_high": estimate.high,
        } | {name: count / self.episodes for name, count in counted}


def _scored(totals: RewardPair, angle: float | None) -> Row:
    """Return the score of one policy at its own angle; an empty row where that is not known."""
    return {} if angle is None else compared([totals], angle)[0]


def _with_interval(name: str, row: Mapping[str, Any]) -> Any:
    """Return a cell of the printed table: a score with its interval, a policy that is the best."""
    if name == "policy" and row.get("best"):
        return f"{row[name]} (best)"
    if name not in ("score", "below_best") or row[name] == row[f"{name}_low"]:
        return row[name]
    return f"{row[name]:.3f} ({row[f'{name}_low']:.3f} to {row[f'{name}_high']:.3f})"


def _play_road(
    driver: Any,
    world: Written,
    angle: float | None,
    allow_code: bool,
    soft: bool,
    shield: float,
    size: int,
    seeds: np.ndarray,
) -> Episodes:
    """Play episodes of a driver on a road; `size` of them run side by side."""
    road = drivers.with_one_ego(world)
    with drivers.driver_of(driver, road, angle, allow_code) as loaded:
        batch: Any = road.batch(size)
        policy = shielded(loaded.policy, batch, shield)
        return episodes_of(batch, policy, seeds, not soft, _quantities(world))


def _quantities(world: Written) -> Mapping[str, Quantity]:
    """Return the quantities of a decision: the conflict rates read the intersection's geometry."""
    return AT_INTERSECTION if world.name == INTERSECTION else DECISION


def _play_in_environment(
    world: Written,
    policy: Any,
    angle: float | None,
    allow_code: bool,
    soft: bool,
    road: drivers.OnRoads,
    seeds: np.ndarray,
) -> tuple[Rollout, Record, float | None]:
    """Play the episodes of successive seeds.

    Returns:
        The episodes, the policy's record, and the share of the decisions of a fallback, if there is
        one.
    """
    name, options = world
    env = environment.make_environment(name, options, allow_code=allow_code, continuous=True)
    how = angle, allow_code, int(seeds[0]), name in TIMED
    with drivers.driver_in(env, policy, world, *how) as loaded:
        read = functools.partial(drivers.driver_in, env, written=world, clock=name in TIMED)
        driver = drivers.with_fallback(road.fallback, policy, loaded, read)
        length = getattr(driver, "n_features", None) or loaded.record.interface.n_features
        if length > environment.sizes(env)[0]:
            env = environment.make_environment(name, {**options, "clock": True}, continuous=True)
        batch = getattr(env.unwrapped, "batch", env.unwrapped)
        shield = shielded(driver, batch, road.shield)
        count = len(seeds)
        rollout = rollout_env(env, shield, count, int(seeds[0]), deterministic=not soft)
        return rollout, loaded.record, driver.share if isinstance(driver, Watched) else None


def pool(rows: Sequence[dict[str, Any]], targets: Sequence[float | None]) -> dict[str, Any]:
    """Return the means over policies of common numbers.

    The angle is that of the mean totals, if all targets are known and equal. Otherwise it would
    describe none of the policies, and `angle_not_pooled` says why there is none.

    Args:
        rows: Numbers of each policy by name.
        targets: Angle in degrees that each policy was trained for; None if it is not known.

    Returns:
        Means by name; intervals are left out.
    """
    names = [name for name in rows[0] if all(isinstance(row.get(name), float) for row in rows)]
    # Intervals belong to one policy's episodes: they can't be averaged.
    names = [name for name in names if not name.endswith(("_low", "_high"))]
    means: dict[str, Any] = {name: float(np.mean([row[name] for row in rows])) for name in names}
    if len(set(targets)) == 1 and targets[0] is not None:
        return means | {"angle": angle_of(means["r_env"], means["r_social"])}
    for name in ("angle", "target_angle", "regret"):
        means.pop(name, None)
    angles = sorted({target for target in targets if target is not None})
    why = f"the policies were trained for {', '.join(f'{target:g}' for target in angles)} degrees"
    if None in targets:
        why = "it is not known whether the policies were trained for one angle"
    return means | {"angle_not_pooled": why}


def target_of(record: Record) -> float | None:
    """Return the angle in degrees that a policy was trained for, or that a dial was set to."""
    return trained_angle(record.details.get("provenance", {}))
