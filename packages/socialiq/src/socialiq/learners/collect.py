"""Experience from environments outside JAX, for learners that train online: any Gymnasium one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.vector import AutoresetMode

from socialiq.errors import UserError
from socialiq.learners import replay
from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.state import Runs
from socialiq.nn.q_network import ValueNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Ending, RewardPair, is_unit_box

Act = Callable[[np.ndarray], Any]
"""From observations, (batch, features), to actions, (batch,), or continuous ones (batch, size)."""

Source = Callable[[Act, np.random.Generator], Batch]
"""Lets a driver act in an environment for a fixed number of steps."""

Behaviour = Callable[[Any, int, int, np.random.Generator], Act]
"""Action selection of a run: given its network, of any kind, its number, the updates
done and its random numbers."""


class Collector:
    """Fills each run's replay from a source of its own, chunk by chunk.

    Pass it as `before_chunk` of a learner's `train`. Every chunk begins with a reset that is
    seeded by the run and the number of updates done, so a resumed run sees the same experience
    as an uninterrupted one.

    Args:
        sources: One for each run.
        seeds: One for each run.
        behaviour: How runs act.
    """

    def __init__(
        self, sources: Sequence[Source], seeds: Sequence[int], behaviour: Behaviour
    ) -> None:
        self.sources, self.seeds, self.behaviour = sources, seeds, behaviour
        self._add = jax.jit(jax.vmap(replay.add_many))

    def __call__(self, runs: Runs, done: int) -> Runs:
        """Let every run act with its present network, and store what happens."""
        batches = [
            self._collect(run, network_of(runs.state.network, run), done)
            for run in range(len(self.sources))
        ]
        stacked = jax.tree.map(lambda *columns: jnp.stack(columns), *batches)
        ring = self._add(runs.carry.replay, stacked)
        return runs._replace(carry=runs.carry._replace(replay=ring))

    def _collect(self, run: int, network: Any, done: int) -> Any:
        rng = np.random.default_rng(np.random.SeedSequence([self.seeds[run], done]))
        return self.collected(run, self.behaviour(network, run, done, rng), rng)

    def collected(self, run: int, act: Act, rng: np.random.Generator) -> Any:
        """Return the experience of a driver in a run's source, columns as the run's replay has."""
        return self.sources[run](act, rng)


class VectorCollector:
    """Fills the replays of all runs from one vector environment: the `before_chunk` of `train`.

    The environments of a run are next to each other. Every chunk begins with a reset that is
    seeded by the run and the updates done. A subclass says how runs act.

    Args:
        env: As many environments for each run; as of `from_vector_env`.
        rounds: Steps of each environment for a chunk.
        hyperparameters: Of each run.

    Raises:
        UserError: If the environments can't be divided among the runs.
    """

    def __init__(
        self,
        env: gymnasium.vector.VectorEnv[Any, Any, Any],
        rounds: int,
        hyperparameters: Sequence[Any],
    ) -> None:
        if env.num_envs % len(hyperparameters):
            raise UserError(
                f"{env.num_envs} environments can't be divided among {len(hyperparameters)} runs"
            )
        self.env, self.rounds, self.numbers = env, rounds, tuple(hyperparameters)
        self.each = env.num_envs // len(hyperparameters)
        self._add = jax.jit(jax.vmap(replay.add_many), donate_argnums=0)

    def __call__(self, runs: Runs, done: int) -> Runs:
        """Let every run act with its present network, and store what happens."""
        streams = [
            np.random.default_rng(np.random.SeedSequence([run.seed, done])) for run in self.numbers
        ]
        firsts = [int(rng.integers(2**31)) for rng in streams]
        # A list, which the type of the base class does not name.
        seeds: Any = [first + row for first in firsts for row in range(self.each)]
        observation, _ = self.env.reset(seed=seeds)
        columns = self.collected(runs, done, streams, observation)
        ring = self._add(runs.carry.replay, columns)
        return runs._replace(carry=runs.carry._replace(replay=ring))

    def collected(
        self,
        runs: Runs,
        done: int,
        streams: Sequence[np.random.Generator],
        observation: np.ndarray,
    ) -> Any:
        """Return the columns of a chunk, (run, step), as the runs' replays have them.

        Args:
            runs: All runs.
            done: Updates done.
            streams: Random numbers of each run.
            observation: What is seen first, of all environments.
        """
        raise NotImplementedError


def soft(temperatures: Sequence[float]) -> Behaviour:
    """Act by softmax(Q/τ), with each run's τ."""

    def behaviour(network: ValueNetwork, run: int, _done: int, rng: np.random.Generator) -> Act:
        policy = QPolicy.of(network, temperatures[run], {}, rng)
        return lambda observation: policy.predict(observation, deterministic=False)[0]

    return behaviour


def acting_in(
    make: Callable[[], gymnasium.Env[Any, Any]],
    static: IQLearnConfig,
    hyperparameters: Sequence[IQLearnHyperparameters],
    chunk: int = 500,
) -> Collector:
    """Let IQ-Learn's runs act in a Gymnasium environment: the `before_chunk` of `train`.

    Args:
        make: Makes the environment, with discrete actions, once for each run.
        static: Of the runs; `env_steps_per_update` is how much they act.
        hyperparameters: Of each run.
        chunk: Updates between two times of acting, the `chunk` of `train`.

    Raises:
        UserError: If the actions are not discrete.
    """
    steps = chunk * static.env_steps_per_update
    sources = [from_env(make(), steps) for _ in hyperparameters]
    behaviour = soft([run.temperature for run in hyperparameters])
    return Collector(sources, [run.seed for run in hyperparameters], behaviour)


def from_env(
    env: gymnasium.Env[Any, Any], steps: int, continuous: bool = False, goes_on: bool = False
) -> Source:
    """Return a source of one environment.

    Args:
        env: With discrete actions, or arrays in [-1, 1]; `types.RewardPair.of_step` and
            `Ending.of_step` say how its rewards and endings are read.
        steps: For each chunk.
        continuous: Whether the learner's actions are arrays.
        goes_on: Whether a chunk goes on where the last one stopped, so that chunks may be shorter
            than episodes; else it begins with a seeded reset. A run that goes on can't be resumed
            from a checkpoint with equal experience.

    Raises:
        UserError: If the actions are of another kind.
    """
    _check_actions(env.action_space, continuous)
    stopped_at: Any = None

    def source(act: Act, rng: np.random.Generator) -> Batch:
        nonlocal stopped_at
        seed = int(rng.integers(2**31))
        observation = env.reset(seed=seed)[0] if stopped_at is None else stopped_at
        rows: list[tuple[Any, ...]] = []
        for _ in range(steps):
            chosen = np.asarray(act(np.ravel(observation)[None]))
            action = chosen[0].astype(np.float32) if continuous else chosen.item()
            after, reward, terminated, truncated, info = env.step(action)
            kind = Ending.of_step(terminated, truncated, info)
            pair = RewardPair.of_step(reward, info)
            rows.append((np.ravel(observation), action, np.ravel(after), kind, *pair))
            observation = env.reset()[0] if kind else after
        stopped_at = observation if goes_on else None
        return _batch(*(np.array(column) for column in zip(*rows, strict=True)))

    return source


def from_vector_env(
    env: gymnasium.vector.VectorEnv[Any, Any, Any], steps: int, continuous: bool = False
) -> Source:
    """Return a source of environments side by side.

    Args:
        env: With discrete actions, or arrays in [-1, 1], and `AutoresetMode.SAME_STEP`. Its
            info has `reward_pair`, (envs, 2), and `ending`, (envs,), values of `types.Ending`,
            both of the step that was taken, also where a reset followed.
        steps: For each chunk, of all environments together.
        continuous: Whether the learner's actions are arrays.

    Raises:
        UserError: If the actions are of another kind, or it resets at another time.
    """
    _check_actions(env.single_action_space, continuous)
    if env.metadata.get("autoreset_mode") != AutoresetMode.SAME_STEP:
        raise UserError("a vector environment must reset in the same step: AutoresetMode.SAME_STEP")

    def source(act: Act, rng: np.random.Generator) -> Batch:
        observation, _ = env.reset(seed=int(rng.integers(2**31)))
        rows = stepped(env, observation, act, -(-steps // env.num_envs))
        columns = (np.concatenate(column)[:steps] for column in zip(*rows, strict=True))
        return _batch(*columns)

    return source


def stepped(
    env: gymnasium.vector.VectorEnv[Any, Any, Any], observation: np.ndarray, act: Act, rounds: int
) -> Iterator[tuple[np.ndarray, ...]]:
    """Step environments side by side; yield the columns of each round, in the order of `Batch`.

    Args:
        env: As of `from_vector_env`.
        observation: What is seen now.
        act: Action selection.
        rounds: Steps of each environment.
    """
    for _ in range(rounds):
        action = np.asarray(act(observation))
        follows, _, _, _, info = env.step(action)
        after = _before_reset(follows, info)
        yield observation, action, after, info["ending"], *info["reward_pair"].T
        observation = follows


def columns_by_run(
    rows: Sequence[tuple[np.ndarray, ...]], count: int, continuous: bool = False
) -> Batch:
    """Return rounds of `stepped` as the columns of each run, (run, step), in order.

    Args:
        rows: Columns of each round, over the environments of all runs, run by run.
        count: Number of runs.
        continuous: Whether actions are arrays.
    """

    def column(number: int, kind: type[np.generic]) -> jax.Array:
        values = np.stack([row[number] for row in rows]).astype(kind)
        values = values.reshape(len(rows), count, -1, *values.shape[2:]).swapaxes(0, 1)
        return jnp.asarray(values.reshape(count, -1, *values.shape[3:]))

    observation, after = column(0, np.float32), column(2, np.float32)
    reward = RewardPair(column(4, np.float32), column(5, np.float32))
    action = column(1, np.float32 if continuous else np.int32)
    return Batch(observation, action, after, column(3, np.int32), reward)


def _before_reset(follows: np.ndarray, info: dict[str, Any]) -> np.ndarray:
    """Return the observations reached by a step, also of environments that were then reset."""
    if "final_obs" not in info:
        return follows
    after = follows.copy()
    for row in np.flatnonzero(info["_final_obs"]):
        after[row] = info["final_obs"][row]
    return after


def _check_actions(space: Any, continuous: bool) -> None:
    if not continuous and not isinstance(space, gymnasium.spaces.Discrete):
        raise UserError("only discrete actions are supported: wrap the environment")
    if continuous and not (isinstance(space, gymnasium.spaces.Box) and is_unit_box(space)):
        raise UserError(
            "continuous actions must be float32 in [-1, 1]: make the environment by "
            "make_environment, which scales them"
        )


def _batch(
    observation: np.ndarray,
    action: np.ndarray,
    after: np.ndarray,
    ending: np.ndarray,
    env: np.ndarray,
    social: np.ndarray,
) -> Batch:
    def column(values: np.ndarray, kind: type[np.generic]) -> jax.Array:
        return jnp.asarray(values.astype(kind))

    return Batch(
        column(observation, np.float32),
        column(action, np.float32 if action.ndim == 2 else np.int32),
        column(after, np.float32),
        column(ending, np.int32),
        RewardPair(column(env, np.float32), column(social, np.float32)),
    )
