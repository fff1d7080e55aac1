"""Experience from environments outside JAX: sources of it, and collectors that fill replays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from types import SimpleNamespace
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.vector import AutoresetMode

from socialiq.errors import UserError
from socialiq.learners.expert_table import Batch, Replay
from socialiq.learners.state import Runs
from socialiq.nn.q_network import network_of
from socialiq.types import Act, Ending, RewardPair, is_unit_box

Source = Callable[[Act, np.random.Generator], Batch]
"""Lets a driver act in an environment for a fixed number of steps."""

Behaviour = Callable[[Any, int, int, np.random.Generator], Act]
"""Action selection of a run: given its network, of any kind, its number, the updates
done and its random numbers."""

Together = Callable[[Any, int, Sequence[np.random.Generator], int], tuple[Act, RewardPair | None]]
"""Action selection of all runs: given their networks, the updates done, the random numbers of each
run and its number of environments. With it the directions of a dial, (run, env), if the replays
have them."""


class BaseCollector:
    """Fills each run's replay, chunk by chunk: the `before_chunk` of a learner's `train`.

    Random numbers of a chunk depend on the run's seed and the number of updates done alone, so a
    resumed run sees the same experience as an uninterrupted one.
    """

    def __init__(self, seeds: Sequence[int]) -> None:
        self._seeds = seeds
        self._add = jax.jit(jax.vmap(Replay.add_many), donate_argnums=0)

    def __call__(self, runs: Runs, done: int) -> Runs:
        """Let every run act with its present network, and store what happens."""
        streams = [
            np.random.default_rng(np.random.SeedSequence([seed, done])) for seed in self._seeds
        ]
        ring = self._add(runs.carry.replay, self.collected(runs, done, streams))
        return runs._replace(carry=runs.carry._replace(replay=ring))

    def collected(self, runs: Runs, done: int, streams: Sequence[np.random.Generator]) -> Any:
        """Return the rows of a chunk.

        Args:
            runs: State of all runs, with the networks that act.
            done: Number of updates done.
            streams: Random numbers of each run.

        Returns:
            The rows as a tree of arrays, (run, row, ...).
        """
        raise NotImplementedError


class Collector(BaseCollector):
    """Fills each run's replay from the run's source, in which it acts by a behaviour.

    Where `driven`, replays have the directions of a dial's `acting.Driver`.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        seeds: Sequence[int],
        behaviour: Behaviour,
        driven: bool = False,
    ) -> None:
        super().__init__(seeds)
        self._sources = sources
        self._behaviour = behaviour
        self._driven = driven

    def collected(self, runs: Runs, done: int, streams: Sequence[np.random.Generator]) -> Any:
        """Return the transitions of each run's source, in its order.

        Args:
            runs: State of all runs, with the networks that act.
            done: Number of updates done.
            streams: Random numbers of each run.

        Returns:
            The batch, (run, row, ...); all sources give the same number of rows.
        """
        batches = []
        for run, rng in enumerate(streams):
            act: Any = self._behaviour(network_of(runs.state.network, run), run, done, rng)
            batch = self._sources[run](act, rng)
            if self._driven:  # a source lists the steps of all environments, step by step
                size = len(batch.action)
                rounds = -(-size // len(act.direction.env))
                columns = (jnp.asarray(np.tile(side, rounds)[:size]) for side in act.direction)
                batch = batch._replace(direction=RewardPair(*columns))
            batches.append(batch)
        return jax.tree.map(lambda *columns: jnp.stack(columns), *batches)


class VectorCollector(BaseCollector):
    """Fills the replays of all runs from one vector environment, as they would collect alone.

    The environments of a run are next to each other, as many for each run, and all actions come
    from one call; only the rounding of the networks' outputs differs. A chunk has `rounds` steps of
    each.

    Raises:
        UserError: If the environments can't be divided among the runs.
    """

    def __init__(
        self,
        env: gymnasium.vector.VectorEnv[Any, Any, Any],
        rounds: int,
        hyperparameters: Sequence[Any],
        behaviour: Together,
    ) -> None:
        count = len(hyperparameters)
        if env.num_envs % count:
            raise UserError(
                f"`num_envs` {env.num_envs} can't be divided among {count} runs: give a multiple"
            )
        super().__init__([run.seed for run in hyperparameters])
        self._env = env
        self._rounds = rounds
        self._together = behaviour

    def collected(self, runs: Runs, done: int, streams: Sequence[np.random.Generator]) -> Any:
        """Return the transitions of a chunk, each run's in the order of the steps.

        Args:
            runs: State of all runs, with the networks that act.
            done: Number of updates done.
            streams: Random numbers of each run.

        Returns:
            The batch, (run, row, ...).
        """
        count = len(streams)
        per_run = self._env.num_envs // count
        firsts = [int(rng.integers(2**31)) for rng in streams]
        # A list, which the type of the base class does not name.
        seeds: Any = [first + row for first in firsts for row in range(per_run)]
        observation, _ = self._env.reset(seed=seeds)
        act, direction = self._together(runs.state.network, done, streams, per_run)
        rows = list(_stepped(self._env, observation, act, self._rounds))

        def by_run(column: Sequence[np.ndarray]) -> np.ndarray:
            values = np.stack(column)
            values = values.reshape(len(rows), count, per_run, *values.shape[2:]).swapaxes(0, 1)
            return values.reshape(count, -1, *values.shape[3:])

        batch = _batch(by_run(column) for column in zip(*rows, strict=True))
        if direction is None:
            return batch
        tiled = jax.tree.map(lambda side: jnp.tile(side, (1, len(rows))), direction)
        return batch._replace(direction=tiled)


def from_env(
    env: gymnasium.Env[Any, Any] | Sequence[gymnasium.Env[Any, Any]],
    steps: int,
    continuous: bool = False,
) -> Source:
    """Return a source of one environment, or of several: of discrete actions, or arrays in [-1, 1].

    `types.RewardPair.of_step` and `Ending.of_step` say how its rewards and endings are read.

    Args:
        env: The environment, or equal ones in which one driver acts side by side.
        steps: Steps of a chunk, of all environments together.
        continuous: Whether actions are arrays in [-1, 1]; else they are discrete.

    Returns:
        The source.

    Raises:
        UserError: If the actions are not discrete, or with `continuous` no float32 box in [-1, 1].
    """
    envs = [env] if isinstance(env, gymnasium.Env) else list(env)
    _check_actions(envs[0].action_space, continuous)

    def source(act: Act, rng: np.random.Generator) -> Batch:
        seed = int(rng.integers(2**31))
        present = [env.reset(seed=(seed + row) % 2**31)[0] for row, env in enumerate(envs)]
        rows: list[tuple[Any, ...]] = []
        for _ in range(steps // len(envs)):
            chosen = np.asarray(act(np.stack([np.ravel(observation) for observation in present])))
            for row, env in enumerate(envs):
                observation = present[row]
                action = chosen[row].astype(np.float32) if continuous else chosen[row].item()
                after, reward, terminated, truncated, info = env.step(action)
                kind = Ending.of_step(terminated, truncated, info)
                pair = RewardPair.of_step(reward, info)
                rows.append((np.ravel(observation), action, np.ravel(after), kind, *pair))
                present[row] = env.reset()[0] if kind else after
        return _batch(np.array(column) for column in zip(*rows, strict=True))

    return source


def from_vector_env(
    env: gymnasium.vector.VectorEnv[Any, Any, Any], steps: int, continuous: bool = False
) -> Source:
    """Return a source of environments side by side, with `AutoresetMode.SAME_STEP`.

    The info has `reward_pair`, (envs, 2), and `ending`, (envs,), values of `types.Ending`, both of
    the step that was taken, also where a reset followed.

    Args:
        env: The environments.
        steps: Steps of a chunk, of all environments together.
        continuous: Whether actions are arrays in [-1, 1]; else they are discrete.

    Returns:
        The source; its rows are in the order of the steps, all environments of a step together.

    Raises:
        UserError: If the actions are not discrete, or with `continuous` no float32 box in [-1, 1];
            or if the environments reset at another time.
    """
    _check_actions(env.single_action_space, continuous)
    if env.metadata.get("autoreset_mode") != AutoresetMode.SAME_STEP:
        raise UserError("a vector environment must reset in the same step: AutoresetMode.SAME_STEP")

    def source(act: Act, rng: np.random.Generator) -> Batch:
        observation, _ = env.reset(seed=int(rng.integers(2**31)))
        rows = _stepped(env, observation, act, -(-steps // env.num_envs))
        return _batch(np.concatenate(column)[:steps] for column in zip(*rows, strict=True))

    return source


def from_simulator(simulator: Any, n_features: int, steps: int) -> Source:
    """Return a source of the episodes of any world's batch, with discrete actions.

    Args:
        simulator: Episodes side by side, a `worlds.world.Simulator`.
        n_features: Length of an observation; one more than the world's ends with the time.
        steps: Steps of a chunk, of all episodes together.

    Returns:
        The source; its rows are in the order of the steps, all episodes of a step together.
    """
    reader = SimpleNamespace(n_features=n_features)

    def source(act: Act, rng: np.random.Generator) -> Batch:
        simulator.reset(rng.integers(2**31, size=simulator.size))
        rows: list[tuple[Any, ...]] = []
        for _ in range(-(-steps // simulator.size)):
            observation = np.array(simulator.seen_by(reader))
            action = np.asarray(act(observation))
            step = simulator.step(action, auto_reset=False)
            after = np.array(simulator.seen_by(reader))
            # An environment of other code, a batch of one, has rewards that are no arrays.
            facts = (np.array(column, ndmin=1) for column in (step.ending, *step.rewards))
            rows.append((observation, action, after, *facts))
            over = np.flatnonzero(step.ending)
            if len(over):
                simulator.reset(rng.integers(2**31, size=len(over)), rows=over)
        return _batch(np.concatenate(column)[:steps] for column in zip(*rows, strict=True))

    return source


def _stepped(
    env: gymnasium.vector.VectorEnv[Any, Any, Any], observation: np.ndarray, act: Act, rounds: int
) -> Iterator[tuple[np.ndarray, ...]]:
    """Step environments side by side; yield the columns of each round, in the order of `Batch`."""
    for _ in range(rounds):
        action = np.asarray(act(observation))
        follows, _, _, _, info = env.step(action)
        after = follows.copy()  # but for environments that were reset, where an episode has ended
        for row in np.flatnonzero(info.get("_final_obs", ())):
            after[row] = info["final_obs"][row]
        yield observation, action, after, info["ending"], *info["reward_pair"].T
        observation = follows


def _check_actions(space: Any, continuous: bool) -> None:
    if not continuous and not isinstance(space, gymnasium.spaces.Discrete):
        raise UserError("only discrete actions are supported: wrap the environment")
    if continuous and not (isinstance(space, gymnasium.spaces.Box) and is_unit_box(space)):
        raise UserError(
            "continuous actions must be float32 in [-1, 1]: make the environment by "
            "make_environment, which scales them"
        )


def _batch(columns: Iterable[np.ndarray]) -> Batch:
    """Return columns of any leading shape as a batch; the rewards are the last two."""
    observation, action, after, ending, env, social = columns
    kind = np.float32 if action.ndim > ending.ndim else np.int32

    def column(values: np.ndarray, dtype: type[np.generic] = np.float32) -> jax.Array:
        return jnp.asarray(values.astype(dtype))

    return Batch(
        column(observation),
        column(action, kind),
        column(after),
        column(ending, np.int32),
        RewardPair(column(env), column(social)),
    )
