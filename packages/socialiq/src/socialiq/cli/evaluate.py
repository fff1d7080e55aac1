"""`evaluate`: metrics of saved policies."""

import functools
import math
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from socialiq.cli import drivers
from socialiq.cli.output import Display, Printing, listed, print_json, print_table, say
from socialiq.demonstrations.mixture import concatenate
from socialiq.errors import UserError
from socialiq.evaluation import context, exact, parts
from socialiq.evaluation.episodes import SIDE_BY_SIDE, Episodes, episodes_of, policy_row
from socialiq.evaluation.rollout import Rollout, rollout_env, rollout_table
from socialiq.evaluation.shield import shielded
from socialiq.evaluation.simulate import Watched
from socialiq.learners.settings import check_seed
from socialiq.policies.card import trained_angle
from socialiq.policies.interface import Record
from socialiq.policies.load import load_policy
from socialiq.social.angle import angle_of, check_angle
from socialiq.social.angle_rule import load_rule
from socialiq.worlds import (
    CONTINUOUS,
    CONTINUOUS_IDS,
    IDS,
    SCENE_IDS,
    SUMO_IDS,
    UNSEEN,
    environment,
    in_sumo,
    registry,
)

TIMED = (*SCENE_IDS, *(SCENE_IDS | SUMO_IDS | CONTINUOUS_IDS).values(), IDS["intersection"])
"""Roads of highway-env and worlds in SUMO, which show the time where a policy takes it."""


@dataclass(frozen=True)
class Evaluate(Printing):
    """Measure saved policies: exactly in a gridworld, or by rollouts anywhere.

    Several policies, for instance one for each training seed, are also pooled: the angle is that of
    the mean totals, if all were trained for one angle.

    A policy may also be a Stable-Baselines3 zip, an ONNX file, process:COMMAND LINE or
    python:FILE.py:NAME, as for `socialiq audit`; a dial is evaluated at --angle. A world may be
    an environment of your own too: a Gymnasium id, MODULE:ID or MODULE:FUNCTION.

    With --data there is no world: J(α) at 0, 15, ..., 90 degrees is estimated from episodes that
    others drove, with 95 % intervals, by fitted Q evaluation and by weighted importance sampling,
    and a line says what the data can't support.

    At the intersection and in SUMO a rule-based driver (go, wait, idm, gap_3s, ...) or a policy of
    the atlas (expert_egoistic, set_egoistic, baseline, prosocial, ...) may be named too.

    Example: socialiq evaluate run/policy_angle45.safetensors --world crossing7 --angle 45
    """

    policies: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Policy files, of `socialiq train`."""
    world: str = "crossing7"
    """crossing5, crossing7, crosswalk7, intersection, intersection-crosswalk (at a class angle:
    -crosswalk-60), intersection-continuous,
    intersection-continuous-steering (with -offroad: leaving the road ends an episode), sumo,
    sumo-row, a network of SUMO (.net.xml), or an environment."""
    data: Path | None = None
    """Demonstrations file with both rewards, in the place of a world."""
    angle: float | None = None
    """Angle in degrees of a dial, and of the regret in a gridworld; by default the angle that each
    policy was trained for, and 0 where that is not known."""
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
    """Processes among which episodes of the intersection or of an environment are split, by seed;
    by default this one plays all."""
    allow_code: bool = False
    """Import the modules that are named: their authors' code runs with your rights."""

    def run(self) -> int:
        """Evaluate and print."""
        check_angle(self.angle or 0.0)
        if self.angle_rule is not None and (
            self.data or self.world not in registry.GRIDWORLDS or self.episodes
        ):
            raise UserError(
                "--angle-rule is exact, in a gridworld without --episodes: at the intersection "
                "`socialiq audit` measures it"
            )
        if not self.policies:
            raise UserError("no policy: name at least one file that `socialiq train` wrote")
        self.road.check(self.world)
        if self.road.fallback and (self.soft or self.processes):
            raise UserError("--fallback goes without --soft and --processes")
        if self.data is not None:
            from socialiq.cli.evaluate_data import evaluate_data  # a network is fitted: needs JAX

            counts = {"--episodes": self.episodes, "--processes": self.processes}
            if options := [name for name, value in counts.items() if value]:
                raise UserError(f"--data rolls nothing out: leave out {', '.join(options)}")
            check_seed(self.seed)
            policies = [str(path) for path in self.policies]
            return evaluate_data(self, policies, self.data)
        rows, targets = map(list, zip(*self.measured(), strict=True))
        if len(rows) == 1:
            return self.show(rows[0], listed(rows[0]))
        pooled = pool(rows, targets)
        if self.json:
            print_json({"policies": rows, "pooled": pooled})
            return 0
        columns = ("policy", "r_env", "r_social", "angle", "arrival", "collision", "off_road")
        columns = (*columns, "length", "target_angle", "regret")
        table = [{"policy": path.name} | row for path, row in zip(self.policies, rows, strict=True)]
        print_table([{key: row[key] for key in columns if key in row} for row in table])
        why = pooled.pop("angle_not_pooled", "")
        print_table(listed(pooled, "pooled"))
        if why:
            sys.stdout.write(f"No pooled angle: {why}.\n")
        return 0

    def measured(self) -> list[tuple[dict[str, Any], float | None]]:
        """Return a row for each policy, and the angle that it was trained for, if known."""
        registry.refuse_file(self.world)
        parts.check_processes(self.processes)
        if self.processes and self.world in (*registry.GRIDWORLDS, *CONTINUOUS):
            raise UserError(f"episodes of {self.world} are not split: leave out --processes")
        names = [str(path) for path in self.policies]
        if self.world in registry.GRIDWORLDS:
            measure = self.gridworld()
        elif self.episodes < 1:
            raise UserError(f"{self.world} can't be evaluated exactly: add --episodes N")
        elif self.world in registry.INTERSECTIONS:
            measure = self.intersection
        else:
            measure = self.environment
        return [measure(name) for name in names]

    @property
    def _seeds(self) -> range:
        return range(self.seed, self.seed + self.episodes)

    def intersection(self, name: str) -> tuple[dict[str, Any], float | None]:
        """Return the metrics of thesis 5.4 with intervals and the conflict rates, and the angle."""
        readout = "soft" if self.soft else "greedy"
        size, shield = min(SIDE_BY_SIDE, self.episodes), self.road.shield
        road = self.world, self.road.shift, self.road.front_end
        world = drivers.intersection_named(*road)
        settings = (name, road, self.angle, self.allow_code, self.soft, shield, size)
        with drivers.driver_of(name, world, self.angle, self.allow_code, self.seed) as loaded:
            driver = drivers.with_fallback(self.road.fallback, name, loaded, world)
            if not self.processes:
                batch, seeds = world.batch(size), np.array(self._seeds)
                policy = shielded(driver, batch, shield)
                episodes = episodes_of(batch, policy, seeds, deterministic=not self.soft)
            elif name == "random" or (self.soft and not loaded.record.soft):
                raise parts.draws_in_order(name)
            else:  # as many side by side as in one
                blocks = parts.blocks_of(self._seeds, self.processes)
                play = functools.partial(_play_road, *settings)
                with Display() as display:
                    report = display.stage("episodes")
                    episodes = parts.joined(parts.in_parts(play, blocks, self.processes, report))
            if (dial := drivers.dial_of(name)) is not None:
                plain = drivers.intersection_named(self.world)
                drivers.complain_if_it_stands(name, dial, drivers.observed(plain, dial))
        # With discrete actions the ego follows its lane.
        row = policy_row(name, readout, episodes, off_road=self.world in CONTINUOUS)
        method: dict[str, Any] = {"method": f"{self.episodes} episodes, seed {self.seed}"}
        method |= {"fallback": driver.share} if isinstance(driver, Watched) else {}
        row = method | {key: value for key, value in row.items() if key != "policy"}
        return row, target_of(loaded.record)

    def gridworld(self) -> Callable[[str], tuple[dict[str, Any], float | None]]:
        """Return exact or sampled metrics of a policy, with regret against the exact optimum."""
        plain = registry.make_grid(self.world)
        optimum = exact.optimum_of(plain)
        readout = "soft" if self.soft else "greedy"
        rule = None if self.angle_rule is None else load_rule(self.angle_rule)

        def measure(name: str) -> tuple[dict[str, Any], float | None]:
            with drivers.driver_of(name, plain, self.angle, self.allow_code) as loaded:
                table = drivers.gridworld_of(self.world, loaded.record.interface)
                states = table.reachable_part()
                if (dial := drivers.dial_of(name)) is not None:
                    drivers.complain_if_it_stands(name, dial, states.observations())
                driven = table if self.episodes else states
                chances = exact.action_table(loaded.policy, driven, readout)
            target = target_of(loaded.record)
            angle = (target or 0.0) if self.angle is None else self.angle
            if self.episodes:
                rollout = rollout_table(table, chances, self.episodes, self.seed)
                metrics, row = rollout.metrics(), self.sampled(rollout)
            else:
                metrics = exact.evaluate_exactly(states, chances)
                row = {"method": "exact", **metrics._asdict()}
                if rule is not None:
                    lost = context.evaluate_by_rule(states, chances, rule).loss
                    row["decision_loss"] = float(lost.sum())
                    for name, loss in zip(rule.contexts, lost.tolist(), strict=True):
                        row[f"decision_loss where {name}"] = loss
            regret = optimum.regret(metrics, angle)
            return {**row, "readout": readout, "target_angle": angle, "regret": regret}, target

        return measure

    def environment(self, policy: str) -> tuple[dict[str, Any], float | None]:
        """Return metrics of a policy in an environment, played in parts if there are processes.

        In parts environment and policy must keep nothing from one episode to the next, as
        Gymnasium's `reset(seed=...)` promises.
        """
        if in_sumo(self.world):
            say(UNSEEN)
        settings = (self.world, self.road.options, policy, self.angle or 0.0, self.allow_code)
        settings = (*settings, self.soft)
        if not self.processes:
            played = [_play_in_environment(*settings, np.array(self._seeds))]
        elif self.soft or policy == "random":
            raise parts.draws_in_order(policy)
        else:
            blocks = parts.blocks_of(self._seeds, self.processes)
            play = functools.partial(_play_in_environment, *settings)
            with Display() as display:
                played = parts.in_parts(play, blocks, self.processes, display.stage("episodes"))
        rollouts = [rollout for rollout, _ in played]
        table = concatenate([rollout.transitions for rollout in rollouts])
        table = replace(table, source=rollouts[0].transitions.source)
        if (dial := drivers.dial_of(policy)) is not None:
            drivers.complain_if_it_stands(policy, dial, table.observation)
        speed = np.concatenate([rollout.speed for rollout in rollouts])
        counted = Counter[str]()
        for rollout in rollouts:
            counted.update(rollout.counted)
        return self.sampled(Rollout(table, speed, counted)), target_of(played[0][1])

    def sampled(self, rollout: Rollout) -> dict[str, Any]:
        """Return the metrics of a rollout, without quantities that are not reported."""
        metrics = rollout.metrics()._asdict().items()
        estimate, counted = rollout.angle(self.seed), rollout.counted.items()
        return {
            "method": f"{self.episodes} episodes, seed {self.seed}",
            **{name: value for name, value in metrics if math.isfinite(value)},
            "angle_low": estimate.low,
            "angle_high": estimate.high,
        } | {name: count / self.episodes for name, count in counted}


def _play_road(
    driver: str,
    world: tuple[str, str, str],
    angle: float | None,
    allow_code: bool,
    soft: bool,
    shield: float,
    size: int,
    seeds: np.ndarray,
) -> Episodes:
    """Play episodes of a driver at the intersection; `size` of them run side by side."""
    road = drivers.intersection_named(*world)
    with drivers.driver_of(driver, road, angle, allow_code) as loaded:
        batch = road.batch(size)
        policy = shielded(loaded.policy, batch, shield)
        return episodes_of(batch, policy, seeds, deterministic=not soft)


def _play_in_environment(
    world: str,
    options: dict[str, Any],
    policy: str,
    angle: float,
    allow_code: bool,
    soft: bool,
    seeds: np.ndarray,
) -> tuple[Rollout, Record]:
    """Play the episodes of successive seeds; return them with the policy's record."""
    env = environment.make_environment(world, options, allow_code=allow_code, continuous=True)
    size, width = environment.sizes(env), environment.action_size(env)
    settings: dict[str, Any] = {"angle": angle, "allow_code": allow_code, "clock": world in TIMED}
    if in_sumo(world):  # rules and the atlas drive there as at the intersection
        layout = drivers.intersection_named("intersection")
        opened = drivers.driver_of(policy, layout, angle, allow_code, int(seeds[0]))
    else:
        opened = load_policy(policy, *size, action_size=width, **settings)
    with opened as loaded:
        if loaded.record.interface.n_features > size[0]:
            env = environment.make_environment(world, {**options, "clock": True}, continuous=True)
        count = len(seeds)
        rollout = rollout_env(env, loaded.policy, count, int(seeds[0]), deterministic=not soft)
        return rollout, loaded.record


def pool(rows: Sequence[dict[str, Any]], targets: Sequence[float | None]) -> dict[str, Any]:
    """Return the means over policies of common numbers.

    The angle is that of the mean totals, if all targets, in degrees, are known and equal. Otherwise
    it would describe none of the policies, and `angle_not_pooled` says why there is none.
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
