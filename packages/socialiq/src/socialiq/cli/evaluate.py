"""`evaluate`: metrics of saved policies."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import gymnasium
import numpy as np
import tyro

from socialiq.cli.drivers import continuous_driver_of, driver_of, gridworld_of
from socialiq.cli.output import Printing, print_json, print_table
from socialiq.cli.pooled import pool, target_of
from socialiq.cli.progress import Display
from socialiq.demonstrations.mixture import concatenate
from socialiq.errors import UserError
from socialiq.evaluation import parts
from socialiq.evaluation.context import evaluate_by_rule
from socialiq.evaluation.episode_rows import policy_row
from socialiq.evaluation.episodes import SIDE_BY_SIDE, Episodes, episodes_of
from socialiq.evaluation.exact import Optimum, action_table, evaluate_exactly
from socialiq.evaluation.rollout import Rollout, rollout_env, rollout_table
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.learners.settings import check_seed
from socialiq.nn.q_policy import ValuePolicy
from socialiq.policies.interface import Loaded
from socialiq.policies.load import load_policy
from socialiq.social.angle import check_angle
from socialiq.social.angle_rule import AngleRule, load_rule
from socialiq.worlds import CONTINUOUS, CONTINUOUS_IDS, IDS, SCENE_IDS
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.environment import action_size, make_environment, sizes
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Batch, Intersection
from socialiq.worlds.registry import GRIDWORLDS, continuous_options, make_grid, refuse_file
from socialiq.worlds.situation import load_driver

FOREIGN = (".onnx", ".zip")
"""Suffixes of policies of other programs."""

ROADS = (IDS["intersection"], *CONTINUOUS_IDS.values())
"""Ids of the intersection, whose environments show the time where a policy takes it."""

Measure = Callable[[ValuePolicy], dict[str, Any]]


@dataclass(frozen=True)
class Evaluate(Printing):
    """Measure saved policies: exactly in a gridworld, or by rollouts anywhere.

    Several policies, for instance one for each training seed, are also pooled: the angle is that of
    the mean totals, if all were trained for one angle.

    In an environment of your own (a Gymnasium id, MODULE:ID or MODULE:FUNCTION) a policy may also
    be a Stable-Baselines3 zip, an ONNX file, or python:MODULE:ATTRIBUTE; a dial is evaluated at
    --angle.

    With --data there is no world: J(α) at 0, 15, ..., 90 degrees is estimated from episodes that
    others drove, with 95 % intervals, by fitted Q evaluation and by weighted importance sampling,
    and a line says what the data can't support.

    At the intersection a rule-based driver (go, wait, idm, gap_3s, ...) or a policy of the atlas
    (expert_egoistic, set_egoistic, baseline, prosocial, ...) may be named too.

    Example: socialiq evaluate run/policy_0.safetensors --world crossing7 --angle 45
    """

    policies: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Policy files, of `socialiq train`."""
    world: str = "crossing7"
    """crossing5, crossing7, intersection, intersection-continuous,
    intersection-continuous-steering (with -offroad: leaving the road ends an episode), or an
    environment."""
    data: Path | None = None
    """Demonstrations file with both rewards, in the place of a world."""
    angle: float = 0.0
    """Angle in degrees at which regret is measured."""
    angle_rule: Path | None = None
    """TOML file of a rule of the angle: the decision loss at it is measured, in a gridworld."""
    soft: bool = False
    """Select actions stochastically, from softmax(Q/τ), instead of greedily."""
    episodes: int = 0
    """Number of episodes to roll out; 0 evaluates exactly, which only gridworlds allow."""
    seed: int = 0
    """Seed of the rollouts and the bootstrap."""
    processes: int = 0
    """Processes among which episodes of the intersection or of an environment are split, by seed;
    by default this one plays all."""
    allow_code: bool = False
    """Import the modules that are named: their authors' code runs with your rights."""

    def run(self) -> int:
        """Evaluate and print."""
        check_angle(self.angle)
        if self.angle_rule is not None and (
            self.data or self.world not in GRIDWORLDS or self.episodes
        ):
            raise UserError(
                "--angle-rule is exact, in a gridworld without --episodes: at the intersection "
                "`socialiq audit` measures it"
            )
        if not self.policies:
            raise UserError("no policy: name at least one file that `socialiq train` wrote")
        if self.data is not None:
            self._from_data(self.data)
            return 0
        rows = self.measured()
        if self.json:
            print_json(
                rows[0] if len(rows) == 1 else {"policies": rows, "pooled": self.pooled(rows)}
            )
        elif len(rows) == 1:
            print_table([{"quantity": name, "value": value} for name, value in rows[0].items()])
        else:
            table = [
                {"policy": path.name} | row for path, row in zip(self.policies, rows, strict=True)
            ]
            columns = ("policy", "r_env", "r_social", "angle", "arrival", "collision", "off_road")
            columns = (*columns, "length")
            print_table([{key: row[key] for key in columns if key in row} for row in table])
            pooled = self.pooled(rows)
            why = pooled.pop("angle_not_pooled", "")
            print_table([{"pooled": name, "value": value} for name, value in pooled.items()])
            if why:
                sys.stdout.write(f"No pooled angle: {why}.\n")
        return 0

    def _from_data(self, data: Path) -> None:
        """Estimate from episodes; nothing is rolled out, so options of rollouts are refused."""
        from socialiq.cli.evaluate_data import evaluate_data  # a network is fitted: needs JAX

        options = [
            name
            for name, value in (
                ("--episodes", self.episodes),
                ("--processes", self.processes),
            )
            if value
        ]
        if options:
            raise UserError(f"--data rolls nothing out: leave out {', '.join(options)}")
        check_seed(self.seed)
        evaluate_data(
            [str(path) for path in self.policies],
            data,
            soft=self.soft,
            seed=self.seed,
            allow_code=self.allow_code,
            json=self.json,
        )

    def pooled(self, rows: list[dict[str, Any]]) -> dict[str, Any]:
        """Return the means over the policies."""
        return pool(rows, [target_of(str(path)) for path in self.policies])

    def measured(self) -> list[dict[str, Any]]:
        """Return a row for each policy."""
        refuse_file(self.world)
        parts.check_processes(self.processes)
        if self.processes and self.world in (*GRIDWORLDS, *CONTINUOUS):
            raise UserError(f"episodes of {self.world} are not split: leave out --processes")
        if self.world == "intersection" or self.world in CONTINUOUS:
            return [self.intersection(str(path)) for path in self.policies]
        if self.world not in GRIDWORLDS:
            return self.environment()
        for path in self.policies:
            if path.suffix in FOREIGN:
                raise UserError(
                    f"{path}: `evaluate` reads {self.world}'s policies as `train` wrote"
                    " them; `socialiq audit` drives other kinds too"
                )
        measure = self.gridworld()
        return [measure(load_driver(path)) for path in self.policies]

    def intersection(self, name: str) -> dict[str, Any]:
        """Return the metrics of thesis 5.4 with intervals, and the conflict rates."""
        self._check_episodes()
        readout = "soft" if self.soft else "greedy"
        if self.world in CONTINUOUS:
            episodes = self._steered(name)
        else:
            episodes = self._split(name) if self.processes else self._played(name)
        # With discrete actions the ego follows its lane.
        row = policy_row(name, readout, episodes, off_road=self.world in CONTINUOUS)
        method = {"method": f"{self.episodes} episodes, seed {self.seed}"}
        return method | {key: value for key, value in row.items() if key not in ("policy",)}

    def _played(self, name: str) -> Episodes:
        """Play the episodes in this process."""
        batch = Batch(Options(), min(self.episodes, SIDE_BY_SIDE))
        seeds = np.array(self._seeds)
        return episodes_of(batch, driver_of(name, self.seed), seeds, deterministic=not self.soft)

    def _steered(self, name: str) -> Episodes:
        """Play the episodes of a policy with continuous actions."""
        options = continuous_options(self.world)
        batch, seeds = Batch(options, min(self.episodes, SIDE_BY_SIDE)), np.array(self._seeds)
        world = Intersection(options)
        driver = continuous_driver_of(name, world, self.angle, self.allow_code, self.seed)
        with driver as loaded:
            return episodes_of(batch, loaded.policy, seeds, deterministic=not self.soft)

    def _split(self, name: str) -> Episodes:
        """Play the episodes in parts, as many side by side as in one."""
        driver = driver_of(name)
        if name == "random" or (self.soft and not isinstance(driver, SoftPolicy)):
            raise parts.draws_in_order(name)
        size = min(SIDE_BY_SIDE, self.episodes)
        blocks = parts.blocks_of(self._seeds, self.processes)
        split = [_RoadPart(name, self.soft, size, block) for block in blocks]
        with Display() as display:
            played = parts.in_parts(_play_road, split, self.processes, display.stage("episodes"))
        return parts.joined(played)

    @property
    def _seeds(self) -> range:
        return range(self.seed, self.seed + self.episodes)

    def gridworld(self) -> Measure:
        """Return exact or sampled metrics, with regret against the exact optimum."""
        optimum = Optimum(tabulate(make_grid(self.world)).reachable_part())
        readout = "soft" if self.soft else "greedy"
        rule = None if self.angle_rule is None else load_rule(self.angle_rule)

        def measure(policy: ValuePolicy) -> dict[str, Any]:
            table = gridworld_of(self.world, policy)
            states = table.reachable_part()
            if self.episodes:
                actions = action_table(policy, table, readout)
                rollout = rollout_table(table, actions, self.episodes, self.seed)
                metrics, row = rollout.metrics(), self.sampled(rollout)
            else:
                chances = action_table(policy, states, readout)
                metrics = evaluate_exactly(states, chances)
                row = {"method": "exact", **metrics._asdict()}
                row |= {} if rule is None else _at_rule(states, chances, rule)
            regret = optimum.regret(metrics, self.angle)
            return {**row, "readout": readout, "target_angle": self.angle, "regret": regret}

        return measure

    def environment(self) -> list[dict[str, Any]]:
        """Return sampled metrics in a Gymnasium environment."""
        self._check_episodes()
        rows = []
        for path in map(str, self.policies):
            rollout = self._in_environment(path)
            rows.append(self.sampled(rollout))
        return rows

    def _in_environment(self, policy: str) -> Rollout:
        """Play the episodes of a policy in an environment, in parts if there are processes.

        In parts environment and policy must keep nothing from one episode to the next, as
        Gymnasium's `reset(seed=...)` promises.
        """
        episodes = _EnvironmentPart(
            self.world, policy, self.angle, self.allow_code, self.soft, np.array(self._seeds)
        )
        if not self.processes:
            return _play_in_environment(episodes)
        if self.soft:
            raise parts.draws_in_order(policy)
        blocks = parts.blocks_of(self._seeds, self.processes)
        split = [episodes._replace(seeds=block) for block in blocks]
        with Display() as display:
            report = display.stage("episodes")
            played = parts.in_parts(_play_in_environment, split, self.processes, report)
        table = concatenate([rollout.transitions for rollout in played])
        table = dataclasses.replace(table, source=played[0].transitions.source)
        return Rollout(table, np.concatenate([rollout.speed for rollout in played]))

    def _check_episodes(self) -> None:
        if self.episodes < 1:
            raise UserError(f"{self.world} can't be evaluated exactly: add --episodes N")

    def sampled(self, rollout: Rollout) -> dict[str, Any]:
        """Return the metrics of a rollout, without quantities that are not reported."""
        metrics = rollout.metrics()._asdict().items()
        estimate = rollout.angle(self.seed)
        return {
            "method": f"{self.episodes} episodes, seed {self.seed}",
            **{name: value for name, value in metrics if math.isfinite(value)},
            "angle_low": estimate.low,
            "angle_high": estimate.high,
        }


def _at_rule(part: Table, chances: np.ndarray, rule: AngleRule) -> dict[str, Any]:
    """Return the decision loss at a rule of the angle, the whole and in each context."""
    lost = evaluate_by_rule(part, chances, rule).loss
    by_context = dict(zip(rule.contexts, lost.tolist(), strict=True))
    row = {"decision_loss": float(lost.sum())}
    return row | {f"decision_loss where {name}": value for name, value in by_context.items()}


class _RoadPart(NamedTuple):
    """Episodes of a driver at the intersection; `size` of them run side by side."""

    driver: str
    soft: bool
    size: int
    seeds: np.ndarray


def _play_road(part: _RoadPart) -> Episodes:
    batch = Batch(Options(), part.size)
    return episodes_of(batch, driver_of(part.driver), part.seeds, deterministic=not part.soft)


class _EnvironmentPart(NamedTuple):
    """Episodes of a policy in an environment, of successive seeds."""

    world: str
    policy: str
    angle: float
    allow_code: bool
    soft: bool
    seeds: np.ndarray


def _play_in_environment(part: _EnvironmentPart) -> Rollout:
    with driven_in(part.world, part.policy, part.angle, part.allow_code) as (env, loaded):
        first, count = int(part.seeds[0]), len(part.seeds)
        return rollout_env(env, loaded.policy, count, first, deterministic=not part.soft)


@contextmanager
def driven_in(
    world: str, driver: str, angle: float, allow_code: bool
) -> Iterator[tuple[gymnasium.Env[Any, Any], Loaded]]:
    """Yield an environment and the policy that drives in it.

    On a road of highway-env a file of this package may take the time as a further feature, which
    the environment then shows, the intersection with continuous actions too.

    Args:
        world: Name, as of `make_environment`.
        driver: The policy, as of `load_policy`.
        angle: Of a dial, in degrees.
        allow_code: Whether a module that is named may be imported.

    Raises:
        UserError: If one can't be made, or they don't fit together.
    """
    env = make_environment(world, allow_code=allow_code, continuous=True)
    shows_time = world in (*SCENE_IDS, *SCENE_IDS.values(), *ROADS)
    settings: dict[str, Any] = {"angle": angle, "allow_code": allow_code, "clock": shows_time}
    with load_policy(driver, *sizes(env), action_size=action_size(env), **settings) as loaded:
        if loaded.record.interface.n_features > sizes(env)[0]:
            env = make_environment(world, {"clock": True}, continuous=True)
        yield env, loaded
