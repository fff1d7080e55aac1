"""Rollouts as demonstrations: on a road, in a gridworld or an environment; the thesis' experts."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from jaxtyping import Float, Int64

from socialiq.demonstrations.columns import steps_of
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import equal_trajectories, equal_transitions
from socialiq.errors import UserError
from socialiq.evaluation import simulate as simulation
from socialiq.evaluation.exact import Metrics
from socialiq.evaluation.measures import DECISION, columns_of
from socialiq.evaluation.simulate import Step, play, simulate
from socialiq.social.angle import AngleEstimate, estimate_angle
from socialiq.types import OBSERVATION, Ending, Policy, RewardPair
from socialiq.worlds.enumerate import GridBatch, Table
from socialiq.worlds.environment import action_bounds
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.observation import ROUTE
from socialiq.worlds.tabular_policy import draw_actions, expert_policy

MODES = {"egoistic": 0.0, "prosocial": 45.0, "altruistic": 90.0}
"""Angle of each of the thesis' experts (5.2), in degrees."""


class Rollout(NamedTuple):
    """Episodes of one policy.

    Attributes:
        transitions: Every transition, in the form of a demonstrations table.
        speed: The ego's speed at each transition; NaN if the environment doesn't report it.
        counted: Sums over all episodes of what the environment counts, by name: others that
            collided with each other, people that were hit.
    """

    transitions: Demonstrations
    speed: Float[np.ndarray, " transition"]
    counted: Mapping[str, float] = MappingProxyType({})

    def __repr__(self) -> str:
        return f"Rollout({self.transitions!r})"

    def metrics(self) -> Metrics:
        """Return the means over the episodes (thesis 5.4)."""
        table = self.transitions
        totals = table.totals()
        counts = np.bincount(table.ending, minlength=len(Ending))
        return Metrics.of(
            totals=RewardPair(totals.env.mean(), totals.social.mean()),
            endings=counts / table.n_episodes,
            mean_speed=self.speed.mean(),
            stopped=(self.speed == 0).mean() if np.isfinite(self.speed).all() else np.nan,
            length=table.n_transitions / table.n_episodes,
        )

    def angle(self, seed: int) -> AngleEstimate:
        """Return α̂ with its bootstrap interval over the episodes."""
        return estimate_angle(*self.transitions.totals(), seed=seed)


class Recorded(NamedTuple):
    """Demonstrations, and for comparison the ego's own and its neighbours' mean reward (A.1)."""

    transitions: Demonstrations
    classical: RewardPair


def record(
    batch: RoadBatch,
    policy: Policy,
    seeds: Sequence[int] | np.ndarray,
    mode: str,
    source: Mapping[str, Any] | None = None,
) -> Recorded:
    """Run one greedy episode for each seed; record every transition, its mode and provenance.

    Args:
        batch: Episodes of a road, on the core.
        policy: Policy that drives.
        seeds: Seed of each episode.
        mode: Name of the driver mode to record.
        source: Further provenance to record.

    Raises:
        UserError: If there is no seed.
    """
    columns, classical = transitions_of(
        play(batch, policy, seeds), lambda result: tuple(result.classical)
    )
    transitions = Demonstrations.of(
        **columns,
        mode_names=(mode,),
        n_actions=0 if batch.options.continuous else batch.n_actions,
        source={
            "first_seed": int(np.min(seeds)),
            "episodes": len(seeds),
            **({OBSERVATION: ROUTE} if batch.options.along_route else {}),
            **(source or {}),
        },
    )
    return Recorded(transitions, RewardPair(*classical))


def transitions_of(
    steps: Iterator[Step], extra: Callable[[Any], tuple[np.ndarray, ...]] = lambda _: ()
) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Return decisions by episode as arguments of `Demonstrations.of`, and further columns.

    Args:
        steps: Decisions, as `play` or `simulate` yields them.
        extra: Function of a decision's result that returns further columns; by default there are
            none.
    """
    blocks = []
    for step in steps:
        result = step.made
        running = step.running
        columns = (step.episode, step.observation, step.action, result.observation, result.ending)
        columns = (*columns, *result.rewards, *extra(result))
        blocks.append([column[running] for column in columns])
    joined = [np.concatenate(column) for column in zip(*blocks, strict=True)]
    order = np.argsort(joined[0], kind="stable")
    episode, observation, action, after, ending, env, social, *further = (
        column[order] for column in joined
    )
    transitions = {
        "observation": observation,
        "action": action,
        "next_observation": after,
        "ending": ending,
        "rewards": RewardPair(env, social),
        "episode": episode,
    }
    return transitions, further


def rollout_table(
    table: Table,
    policy: Float[np.ndarray, "*time state action"],
    episodes: int,
    seed: int,
    mode: str = "policy",
    source: Mapping[str, Any] | None = None,
) -> Rollout:
    """Run a policy in an enumerated world, all episodes side by side.

    Args:
        table: The world with all its states (not the reachable part, which lacks final states).
        policy: Action probabilities by state, or by time and state.
        episodes: Number of episodes.
        seed: Seed of chance and of the policy's draws.
        mode: Name of the driver mode to record.
        source: Provenance to record.

    Raises:
        UserError: If `episodes` is less than 1.
    """
    columns, _ = transitions_of(_steps(table, policy, episodes, seed))
    state = columns["observation"]
    step = steps_of(columns["episode"])
    columns["observation"] = table.observe(state, step)
    columns["next_observation"] = table.observe(columns["next_observation"], step + 1)
    transitions = Demonstrations.of(
        **columns,
        mode_names=(mode,),
        n_actions=table.mdp.n_actions,
        source={"world": table.world.name, **_options_of(table), "seed": seed, **(source or {})},
    )
    return Rollout(transitions, table.speed[state, columns["action"]])


def _options_of(table: Table) -> dict[str, Any]:
    """Return the options of a gridworld that are not its default ones, for provenance."""
    options = dataclasses.asdict(table.world.options)
    default = dataclasses.asdict(type(table.world.options)())
    changed = {name: value for name, value in options.items() if value != default[name]}
    return {"options": changed} if changed else {}


def rollout_totals(
    table: Table, policy: Float[np.ndarray, "*time state action"], episodes: int, seed: int
) -> Float[np.ndarray, "episode 2"]:
    """Return the sums of r_env and r_social of episodes in an enumerated world.

    Args:
        table: The world with all its states, or its reachable part.
        policy: Action probabilities by state, or by time and state.
        episodes: Number of episodes.
        seed: Seed of chance and of the policy's draws; the episodes are those of `rollout_table`.

    Raises:
        UserError: If `episodes` is less than 1.
    """
    rewards = {name: DECISION[name] for name in ("r_env", "r_social")}
    steps = _steps(table, policy, episodes, seed)
    return np.stack(columns_of(steps, episodes, rewards).totals, axis=1)


def _steps(
    table: Table, policy: Float[np.ndarray, "*time state action"], episodes: int, seed: int
) -> Iterator[Step]:
    """Return the decisions of episodes that begin at once and share one source of chance."""
    if episodes < 1:
        raise UserError(f"episodes must be at least 1, got {episodes}")
    rng = np.random.default_rng(seed)

    def draw(time: int, state: np.ndarray, running: np.ndarray) -> Int64[np.ndarray, " row"]:
        chances = policy[time] if policy.ndim == 3 else policy
        action = np.zeros(len(running), np.int64)
        action[running] = draw_actions(chances[state[running]], rng)
        return action

    batch = GridBatch(table, episodes, rng)
    return simulate(batch, simulation.ScriptedActor(draw), np.arange(episodes))


def rollout_env(
    env: gymnasium.Env[Any, Any],
    policy: Policy,
    episodes: int,
    seed: int,
    deterministic: bool = True,
    mode: str = "policy",
    source: Mapping[str, Any] | None = None,
) -> Rollout:
    """Run a policy in a Gymnasium environment.

    `info["reward_pair"]` gives (r_env, r_social); without it the scalar reward counts as r_env and
    r_social is 0. `info["ending"]` names the ending; without it a terminal state is `OTHER`.
    `info["speed"]` is recorded, and `info["neighbours_collided"]` and signals of hits (`_hit`) are
    counted if the environment gives them.

    Args:
        env: The environment: with discrete actions, or with actions in [-1, 1] as
            `worlds.environment.make_environment` makes it.
        policy: Anything with `predict`.
        episodes: Number of episodes; episode i is reset with seed + i.
        seed: Seed of the environment.
        deterministic: Passed to `predict`.
        mode: Name of the driver mode to record.
        source: Provenance to record.

    Raises:
        UserError: If `episodes` is less than 1, or the kind of actions is another one.
    """
    if episodes < 1:
        raise UserError(f"episodes must be at least 1, got {episodes}")
    seeds = np.arange(seed, seed + episodes)
    simulator = simulation.GymSimulator(env)
    actor = simulation.GymActor(policy, deterministic, simulator)
    steps = list(simulate(simulator, actor, seeds))
    space = env.action_space
    pairs = np.array([step.made.rewards for step in steps], np.float64)
    transitions = Demonstrations.of(
        observation=[np.ravel(step.observation[0]) for step in steps],
        action=[step.action[0] for step in steps],
        next_observation=[np.ravel(step.made.observation) for step in steps],
        ending=[step.made.ending[0] for step in steps],
        rewards=RewardPair(*pairs.T),
        episode=[step.episode[0] for step in steps],
        mode_names=(mode,),
        n_actions=int(space.n) if isinstance(space, gymnasium.spaces.Discrete) else 0,
        source={"seed": seed, "episodes": episodes, **action_bounds(env), **(source or {})},
    )
    speed = np.array([step.made.speed for step in steps], np.float64)
    counted = Counter[str]()
    for step in steps:
        counted.update(step.made.counted)
    return Rollout(transitions, speed, counted)


def demonstrations_by_mode(
    table: Table, episodes: dict[str, int], seed: int
) -> dict[str, Demonstrations]:
    """Roll out each of the thesis' experts (5.2) in the stochastic world with all its states.

    Args:
        table: The world with all its states.
        episodes: Number of episodes of each mode, by its name.
        seed: Seed; each mode has a separate random stream.
    """
    demonstrations = {}
    for number, (mode, angle) in enumerate(MODES.items()):
        source = {"expert": "value iteration, deterministic variant", "angle": angle}
        policy = expert_policy(table, angle)
        stream = len(MODES) * seed + number
        rollout = rollout_table(table, policy, episodes[mode], stream, mode, source)
        demonstrations[mode] = rollout.transitions
    return demonstrations


def trajectory_datasets(
    table: Table, seeds: Sequence[int], episodes_each: int
) -> list[Demonstrations]:
    """Return, for each seed, a mixture with equal numbers of new episodes of every expert (5.2).

    Args:
        table: The world with all its states.
        seeds: Seed of each mixture.
        episodes_each: Number of episodes of each expert.
    """
    return [
        equal_trajectories(
            demonstrations_by_mode(table, dict.fromkeys(MODES, episodes_each), seed),
            episodes_each,
            seed,
        )
        for seed in seeds
    ]


def transition_datasets(
    table: Table, seeds: Sequence[int], transitions_each: int
) -> list[Demonstrations]:
    """Return, for each seed, a mixture with equal numbers of transitions of every expert (6.3).

    Args:
        table: The world with all its states.
        seeds: Seed of each mixture.
        transitions_each: Number of transitions of each expert.
    """
    enough = dict.fromkeys(MODES, transitions_each)  # an episode has at least one transition
    return [
        equal_transitions(demonstrations_by_mode(table, enough, seed), transitions_each, seed)
        for seed in seeds
    ]
