"""Rollouts as tables of transitions, in an enumerated gridworld or a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from jaxtyping import Float, Int

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.evaluation.metrics import Metrics
from socialiq.social.angle import AngleEstimate, estimate_angle
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.enumerate import Table
from socialiq.worlds.tabular_policy import draw_actions

MOST_STEPS = 100_000
"""Largest number of steps of an episode in a Gymnasium environment without a time limit."""


class Rollout(NamedTuple):
    """Episodes of one policy.

    Attributes:
        transitions: Every transition, in the form of a demonstrations table.
        speed: The ego's speed at each transition; NaN if the environment doesn't report it.
    """

    transitions: Demonstrations
    speed: Float[np.ndarray, " transition"]

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
        episodes: How many.
        seed: Of chance and of the policy's draws.
        mode: Name of the driver mode to record.
        source: Provenance to record.

    Raises:
        UserError: If no episode is asked for.
    """
    episode, step, state, action, after, ending = _steps(table, policy, episodes, seed)
    mdp = table.mdp
    transitions = Demonstrations.of(
        observation=table.observe(state, step),
        action=action,
        next_observation=table.observe(after, step + 1),
        ending=ending,
        rewards=RewardPair(mdp.rewards.env[state, action], mdp.rewards.social[state, action]),
        episode=episode,
        step=step,
        mode_names=(mode,),
        n_actions=mdp.n_actions,
        source={"world": table.world.name, "seed": seed, **(source or {})},
    )
    return Rollout(transitions, table.speed[state, action])


def rollout_totals(
    table: Table, policy: Float[np.ndarray, "*time state action"], episodes: int, seed: int
) -> Float[np.ndarray, "episode 2"]:
    """Return the sums of r_env and r_social of each episode in an enumerated world.

    Args:
        table: The world or its reachable part.
        policy: Action probabilities by state, or by time and state.
        episodes: How many.
        seed: Of chance and of the policy's draws.

    Raises:
        UserError: If no episode is asked for.
    """
    episode, _, state, action, _, _ = _steps(table, policy, episodes, seed)
    return np.stack(
        [np.bincount(episode, reward[state, action]) for reward in table.mdp.rewards], axis=1
    )


def _steps(
    table: Table, policy: Float[np.ndarray, "*time state action"], episodes: int, seed: int
) -> list[Int[np.ndarray, " transition"]]:
    """Return columns of all transitions: episode, step, state, action, next state, ending."""
    _check_episodes(episodes)
    rng = np.random.default_rng(seed)
    mdp = table.mdp
    state = rng.choice(mdp.n_states, size=episodes, p=mdp.initial)
    running = np.arange(episodes)
    rows: list[tuple[np.ndarray, ...]] = []
    for time in range(table.world.horizon):
        chances = policy[time] if policy.ndim == 3 else policy
        action = draw_actions(chances[state], rng)
        outcome = draw_actions(mdp.probability[state, action], rng)
        after = mdp.successor[state, action, outcome]
        ending = mdp.ending[state, action, outcome]
        if time == table.world.horizon - 1:
            ending = np.where(ending == Ending.NONE, int(Ending.TIMEOUT), ending)
        rows.append((running, np.full_like(running, time), state, action, after, ending))
        going = ending == Ending.NONE
        running, state = running[going], after[going]
    columns = [np.concatenate(part) for part in zip(*rows, strict=True)]
    order = np.argsort(columns[0], kind="stable")
    return [column[order] for column in columns]


def rollout_env(
    env: gymnasium.Env[Any, Any],
    policy: Policy,
    episodes: int,
    seed: int,
    deterministic: bool = True,
    mode: str = "policy",
    source: Mapping[str, Any] | None = None,
) -> Rollout:
    """Run a policy in a Gymnasium environment with discrete actions.

    `info["reward_pair"]` gives (r_env, r_social); without it the scalar reward counts as r_env
    and r_social is 0. `info["ending"]` names the ending; without it a terminal state is `OTHER`.
    `info["speed"]` is recorded if it is there.

    Args:
        env: The environment.
        policy: Anything with `predict`.
        episodes: Number of episodes; episode i is reset with seed + i.
        seed: Seed of the environment.
        deterministic: Passed to `predict`.
        mode: Name of the driver mode to record.
        source: Provenance to record.

    Raises:
        UserError: If no episode is asked for, or the actions are not discrete.
    """
    _check_episodes(episodes)
    seeds = range(seed, seed + episodes)
    taken = list(steps(env, policy, seeds, deterministic))
    assert isinstance(env.action_space, gymnasium.spaces.Discrete)  # `steps` refuses others
    return _table(taken, int(env.action_space.n), mode, {"seed": seed, **(source or {})})


class Taken(NamedTuple):
    """Step of an episode.

    Attributes:
        episode: Number of the episode, from 0.
        observation: Observation before the step.
        action: The chosen action.
        after: The next observation.
        ending: Ending of the episode at this step, NONE if it continues.
        pair: The reward pair.
        speed: The ego's speed, NaN if not reported.
    """

    episode: int
    observation: Any
    action: int
    after: Any
    ending: Ending
    pair: RewardPair
    speed: float


def steps(
    env: gymnasium.Env[Any, Any],
    policy: Policy,
    seeds: Sequence[int],
    deterministic: bool = True,
) -> Iterator[Taken]:
    """Run one episode for each seed, and yield each step.

    Args:
        env: Environment with discrete actions.
        policy: Anything with `predict`.
        seeds: Seeds of the episodes' resets.
        deterministic: Passed to `predict`.

    Raises:
        UserError: If the actions are not discrete, or an episode doesn't end.
    """
    if not isinstance(env.action_space, gymnasium.spaces.Discrete):
        raise UserError("only discrete actions are supported: wrap the environment")
    for episode, seed in enumerate(seeds):
        observation, _ = env.reset(seed=seed)
        state, ending, length = None, Ending.NONE, 0
        while ending == Ending.NONE:
            if length == MOST_STEPS:
                raise UserError(
                    f"an episode has not ended after {MOST_STEPS:,} steps: wrap the environment "
                    "in gymnasium.wrappers.TimeLimit"
                )
            action, state = policy.predict(observation, state, deterministic=deterministic)
            after, reward, terminated, truncated, info = env.step(int(action))
            ending = Ending.of_step(terminated, truncated, info)
            pair, speed = RewardPair.of_step(reward, info), float(info.get("speed", np.nan))
            yield Taken(episode, observation, int(action), after, ending, pair, speed)
            observation, length = after, length + 1


def _table(taken: list[Taken], n_actions: int, mode: str, source: dict[str, Any]) -> Rollout:
    pairs = np.array([one.pair for one in taken], np.float64)
    transitions = Demonstrations.of(
        observation=[np.ravel(one.observation) for one in taken],
        action=[one.action for one in taken],
        next_observation=[np.ravel(one.after) for one in taken],
        ending=[one.ending for one in taken],
        rewards=RewardPair(*pairs.T),
        episode=[one.episode for one in taken],
        mode_names=(mode,),
        n_actions=n_actions,
        source=source,
    )
    return Rollout(transitions, np.array([one.speed for one in taken], np.float64))


def _check_episodes(episodes: int) -> None:
    if episodes < 1:
        raise UserError(f"episodes must be at least 1, got {episodes}")
