"""Seeded episodes of one driver in any world: a policy, an exact optimum, or a trivial driver."""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from jaxtyping import Float, Int64

from socialiq.audit.evidence.outcomes import (
    AS_DECLARED,
    COLUMNS,
    LOSS,
    Outcomes,
    Reference,
)
from socialiq.audit.profile.environment import LARGEST_SEED
from socialiq.evaluation import effects, simulate
from socialiq.evaluation.context import DecisionLosses, by_turning, losses_of, state_angles
from socialiq.evaluation.exact import optima_of
from socialiq.evaluation.measures import DECISION, Episodes, Quantity, columns_of
from socialiq.mdp.horizon import horizon_evaluation
from socialiq.nn.dial_policy import DialPolicy
from socialiq.policies.drivers import showing
from socialiq.policies.interface import Interface
from socialiq.social.angle_rule import AngleRule
from socialiq.types import Ending, Memoryless, RewardPair
from socialiq.worlds.catalogue import in_sumo
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.world import Actor, ConstantPolicy, Simulator, World

SIDE_BY_SIDE = 512  # episodes at once; memory doesn't grow with their number

CANDIDATES = tuple(15.0 * step for step in range(7))
"""Angles at which the decision losses of the policy are measured in each context, in degrees."""


class ByRule(NamedTuple):
    """A declared rule of the angle, and the reference dial that it turns.

    In a gridworld the optima are known, and the dial is None.
    """

    rule: AngleRule
    dial: DialPolicy | None


class Course:
    """Episodes of a world, by their seeds, that every driver of an audit is run on.

    On a road `size` episodes run side by side. The last bits of a network's output may depend on
    this number, so parts of one collection need the same. In a gridworld all run at once, and a
    policy with a memory keeps one for each. By a declared rule of the angle decision losses are
    measured. For effects that have bounds each episode of a road is driven again; its rewards don't
    change. A world in SUMO plays the traffic without the ego in parallel with each episode.
    """

    def __init__(
        self,
        world: World,
        seeds: Int64[np.ndarray, " episode"],
        side_by_side: int | None = None,
        threads: int = 1,
        by_rule: ByRule | None = None,
        measured: Sequence[str] = (),
    ) -> None:
        self.world = world
        self.seeds = seeds
        self.by_rule = by_rule
        self._threads = threads
        self.size = side_by_side or min(SIDE_BY_SIDE, len(seeds))
        # The episodes that run side by side, and their losses at a declared rule in a gridworld.
        self.batch: Any = world.batch(len(seeds) if world.is_exact else self.size, threads)
        self.losses = None
        self._effects = measured
        self._begun: effects.Begun = {}
        # Rewards, lengths and effects of a decision.
        self._quantities = {name: DECISION[name] for name in ("r_env", "r_social", "length")}
        if by_rule is not None and world.is_exact:
            self.losses = DecisionLosses(self.batch.table, by_rule.rule, CANDIDATES)
        if measured and world.is_exact:
            reachable = np.asarray(self.batch.table.world.index(self.batch.table.states))
            caused = effects.caused_by_step(world.table())
            self._quantities |= {
                name: Quantity(
                    "",
                    lambda step, effect=caused[name][reachable]: effect[
                        step.observation, step.action
                    ],
                )
                for name in measured
            }
        elif in_sumo(world.name):  # the signals of each step are what the ego causes
            self._quantities |= {
                name: Quantity(
                    "", lambda step, signal=effects.IN_SUMO[name]: step.made.signals[signal]
                )
                for name in measured
            }

    def blocks(self, size: int) -> Iterator[Course]:
        """Yield the course of each block of episodes; a block has at most `size` of them."""
        for first in range(0, len(self.seeds), size):
            block = copy.copy(self)
            block.seeds = self.seeds[first : first + size]
            block.size = min(size, self.size)
            block.batch = self.world.batch(block.size, self._threads)
            block.batch.reset(np.arange(block.batch.size))  # a policy meets rows without an episode
            yield block

    def _showing(self, schema: str) -> Course:
        """Return the same episodes with observations of a schema, as `World.schema`."""
        course = copy.copy(self)
        course.world = showing(self.world, schema)
        course.batch = course.world.batch(self.size, self._threads)
        course._begun = {}
        return course

    def drive(
        self, driver: Reference, deterministic: bool = True, candidates: tuple[float, ...] = ()
    ) -> Outcomes:
        """Run a driver on all episodes; a stochastic `SoftPolicy` draws from the episodes' seeds.

        In an environment fault is not known: every collision counts as the driver's.

        Args:
            driver: The driver.
            deterministic: Whether it takes its best actions.
            candidates: Angles in degrees at which decision losses are measured too, if a declared
                rule is tested by a dial.

        Returns:
            Outcomes with the driver's name and angles, and with the effects that have bounds.

        Raises:
            UserError: If its answers are not one of the world's actions for each episode, an
                environment fails, or an episode doesn't end.
        """
        if driver.schema not in ("", self.world.schema):
            return self._showing(driver.schema).drive(driver, deterministic, candidates)
        rule = self.by_rule
        world = self.world
        if rule is None or rule.dial is None:
            actor = actor_of(world, self.batch, driver, deterministic)
            outcomes = self.outcomes(driver.name, actor, driver.angles)
        else:
            how = rule.dial, rule.rule, candidates, deterministic
            episodes, losses = losses_of(self.batch, driver.policy, self.seeds, *how)
            columns = {name: episodes[name] for name in COLUMNS}
            columns[LOSS] = losses.declared.sum(axis=1)
            outcomes = Outcomes(driver.name, Episodes(columns), driver.angles, contexts=losses)
        if not self._effects or world.is_exact or in_sumo(world.name):
            return outcomes
        scene = getattr(world, "scene_world", None)
        seeds = self.seeds
        road = cast(RoadWorld, scene or world)
        caused = effects.caused(
            road,
            lambda batch: actor_of(road, batch, driver, deterministic),
            seeds % LARGEST_SEED if scene else seeds,
            self.size,
            self._threads,
            self._begun,
        )
        return outcomes.with_columns(**{name: caused[name] for name in self._effects})

    def outcomes(
        self,
        name: str,
        actor: Actor,
        angles: tuple[float, ...] = (),
        expected: RewardPair | None = None,
    ) -> Outcomes:
        """Run an actor on all episodes.

        Args:
            name: Name of the driver.
            actor: The actor.
            angles: Angles of the driver in degrees, as in `Outcomes`.
            expected: Exact totals of the driver, where they are known.
        """
        count = len(self.seeds)
        contexts = None if self.losses is None else self.losses.begin(count)
        steps = simulate.simulate(self.batch, actor, self.seeds)
        if self.losses is not None and contexts is not None:
            steps = self.losses.noting(steps, contexts)
        episodes = columns_of(steps, count, self._quantities)
        assert (episodes.ending != Ending.NONE).all()
        if contexts is not None:
            episodes = Episodes({LOSS: contexts.declared.sum(axis=1)} | episodes)
        return Outcomes(name, episodes, angles, expected, contexts)


def actor_of(world: World, batch: Simulator, driver: Reference, deterministic: bool) -> Actor:
    """Return the actor of a driver in episodes side by side, or in an environment one by one.

    In a gridworld, where all episodes begin at once, a policy may have a memory for each of them.

    Args:
        world: World of the episodes.
        batch: Simulator of the episodes.
        driver: The driver; its name is in the message if an answer is invalid.
        deterministic: Whether it takes its best actions. If not, a `SoftPolicy` draws from the
            seeds of the episodes, in worlds that allow it.
    """
    policy = driver.policy
    sizes = Interface.of(world)
    if not deterministic and world.draws_by_seed and isinstance(policy, simulate.SoftPolicy):
        return simulate.SoftActor(policy, batch)
    if isinstance(policy, ConstantPolicy):
        return simulate.always(policy)
    if isinstance(batch, simulate.GymSimulator):
        return simulate.GymActor(policy, deterministic, batch)
    checked = functools.partial(sizes.checked, source=driver.name)
    return simulate.PolicyActor(policy, batch, deterministic, world.is_exact, checked)


def exactly_as_declared(course: Course, rule: AngleRule) -> Outcomes:
    """Run the exact dial of a gridworld turned by a declared rule; its decision loss is 0.

    Args:
        course: Episodes of the gridworld.
        rule: The declared rule.

    Returns:
        Outcomes with the name `AS_DECLARED` and the exact expectation.
    """
    table = course.batch.table
    chances = by_turning(table, state_angles(table, rule))
    exact = horizon_evaluation(table.mdp, chances, table.world.horizon).totals
    actions = chances.argmax(axis=2)
    actor = simulate.ScriptedActor(lambda time, states, _: actions[time, states])
    return course.outcomes(AS_DECLARED, actor, expected=exact)


def exact_optima(course: Course) -> tuple[Outcomes, ...]:
    """Run the exact optima of a gridworld, one for each vertex of the attainable set.

    Together they are the best at every angle, so the largest J(α) among them is J*(α) itself.
    They depend on the time; `Outcomes.expected` has the exact expectation.
    """
    optima = []
    for vertex, (angles, actions, exact) in enumerate(optima_of(course.batch.table.world)):
        actor = simulate.ScriptedActor(lambda time, at, _, plan=actions: plan[time, at])
        optima.append(course.outcomes(f"optimum_{vertex:02d}", actor, angles, exact))
    return tuple(optima)


PREFIX = "trivial_"
"""Beginning of the names of trivial drivers: constant actions and uniformly random ones. They are
no references of the regret test. A declaration that all of them would pass excludes nothing."""

RANDOM = f"{PREFIX}random"

GO_AND_WAIT = ("go", "wait")
"""Constant drivers of the intersection, which are references already, by name of their rule."""


class UniformPolicy(Memoryless):
    """Policy that chooses each of some actions with the same probability, whatever it observes."""

    def __init__(self, actions: int) -> None:
        self._actions = actions

    def choose(self, observation: Any, _deterministic: bool, /) -> np.ndarray:
        """Return the first action: the draws follow `probabilities`.

        Args:
            observation: Batch of observations, of which only the number of rows matters.

        Returns:
            Zeros, one for each row.
        """
        return np.zeros(len(observation), np.int64)

    def probabilities(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return equal probabilities."""
        return np.full((len(observations), self._actions), 1.0 / self._actions)


def trivial_drivers(course: Course) -> tuple[Outcomes, ...]:
    """Run the first action, the last action, and random ones, drawn by the seeds of the episodes.

    The first is to wait, the last to go as fast as possible; in an environment their meaning is not
    known. Of continuous actions they are the lower and upper ends of all numbers. Where the world
    itself has references, the constant drivers are among them.
    """
    world = course.world
    interface = Interface.of(course.world)
    constant: dict[str, Any] = {}
    if not world.references and interface.action_size:
        ends = {"lowest_values": -1.0, "highest_values": 1.0}
        constant = {
            name: np.full(interface.action_size, end, np.float32) for name, end in ends.items()
        }
    elif not world.references:
        names = getattr(world, "actions", [f"action_{k}" for k in range(interface.n_actions)])
        constant = {names[0]: 0, names[-1]: interface.n_actions - 1}
    outcomes = [
        course.drive(Reference(f"{PREFIX}{name}", ConstantPolicy(action)))
        for name, action in constant.items()
    ]
    if world.is_exact:
        horizon = course.batch.table.world.horizon
        rngs = (np.random.default_rng([simulate.UNIFORM, seed]) for seed in course.seeds.tolist())
        actions = [rng.integers(interface.n_actions, size=horizon) for rng in rngs]
        table = np.array(actions).T
        random = course.outcomes(RANDOM, simulate.ScriptedActor(lambda time, _, __: table[time]))
    elif interface.action_size:
        random = course.outcomes(RANDOM, simulate.UniformActor(interface.action_size, course.batch))
    else:
        driver = Reference(RANDOM, UniformPolicy(interface.n_actions))
        random = course.drive(driver, deterministic=False)
    return (*outcomes, random)
