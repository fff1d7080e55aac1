"""Seeded episodes of any simulator and any policy: one loop, and the actors that policies drive by.

A `world.Simulator` is a batch of a world or, here, a Gymnasium environment. An `Actor` adapts a
policy to it. Experience for online learners has no seeded episodes; its loops are in
`learners.collect`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import gymnasium
import numpy as np
from jaxtyping import Bool, Float, Float32, Int64, Shaped

from socialiq.errors import UserError
from socialiq.types import Ending, Policy, RewardPair, is_unit_box
from socialiq.worlds.world import Actor, ConstantPolicy, Simulator

SOFT = 4172  # makes draws of soft policies independent of other draws from the same seed
UNIFORM = 6011  # likewise, of uniform actions
BLOCK = 64  # random numbers that are drawn at once for an episode


class Step(NamedTuple):
    """One decision of the episodes that are running; columns have a value for each row.

    Attributes:
        episode: Number of the episode in each row.
        running: Rows that decided.
        observation: Before the decision.
        rows: Rows of road users before the decision, where `observation` has another schema; else
            the observation.
        reached: Rows of road users after it.
        action: Those of running rows alone are used.
        made: Result of the simulator: at least `rewards` and `ending`.
    """

    episode: Int64[np.ndarray, " row"]
    running: Bool[np.ndarray, " row"]
    observation: Any
    rows: Any
    action: Int64[np.ndarray, " row"] | Float[np.ndarray, "row value"]
    made: Any
    reached: Any


def simulate(
    simulator: Simulator, actor: Actor, seeds: Sequence[int] | np.ndarray
) -> Iterator[Step]:
    """Run one episode for each seed, decision by decision.

    A row takes the next seed as soon as its episode has ended.

    Args:
        simulator: Episodes side by side.
        actor: Actor that drives them.
        seeds: Seed of each episode.

    Yields:
        Each decision of all rows.

    Raises:
        UserError: If there are no seeds.
    """
    queue = np.asarray(seeds)
    if not len(queue):
        raise UserError("episodes must be at least 1, got 0")
    episode = np.arange(simulator.size)
    running = episode < len(queue)
    begun = np.flatnonzero(running)
    following = int(running.sum())
    while running.any():
        if len(begun):
            simulator.reset(queue[episode[begun]], rows=begun)
            actor.begin(begun, queue[episode[begun]])
        observation = simulator.observation
        rows = shown_rows(simulator, observation)
        action = actor.decide(observation, running)
        result = simulator.step(action, auto_reset=False, rows=running)
        reached = shown_rows(simulator, getattr(result, "observation", None))
        yield Step(episode.copy(), running.copy(), observation, rows, action, result, reached)
        free = np.flatnonzero(running & _over(simulator, result.ending))
        begun = free[: max(len(queue) - following, 0)]
        running[free[len(begun) :]] = False
        episode[begun] = following + np.arange(len(begun))
        following += len(begun)


def shown_rows(simulator: Any, observation: Any) -> Any:
    """Return the rows of road users that are shown now, which a schema of a road may replace.

    Args:
        simulator: Episodes side by side.
        observation: What they show policies.
    """
    rows = getattr(simulator, "shown_rows", observation)
    return observation if np.shape(rows) == np.shape(observation) else rows.copy()


def _over(simulator: Any, ending: np.ndarray) -> Bool[np.ndarray, " row"]:
    """Return whether each episode is over; one of several agents lasts as its batch says."""
    return ending != int(Ending.NONE) if ending.ndim == 1 else ~simulator.running


def play(
    simulator: Simulator,
    policy: Policy,
    seeds: Sequence[int] | np.ndarray,
    deterministic: bool = True,
) -> Iterator[Step]:
    """Run a policy of the whole batch on one episode for each seed.

    The time is a last feature of the input if the policy has one feature more than the world.
    A `SoftPolicy` that is not deterministic draws by the episode's seed, so its episodes don't
    depend on the batch (`SoftActor`); to other policies `deterministic` is passed.

    Args:
        simulator: Episodes side by side.
        policy: Policy that drives them.
        seeds: Seed of each episode.
        deterministic: Whether the policy takes its best action.

    Yields:
        Each decision of all rows.

    Raises:
        UserError: If there are no seeds.
    """
    return simulate(simulator, actor_of(simulator, policy, deterministic), seeds)


def actor_of(simulator: Simulator, policy: Policy, deterministic: bool = True) -> Actor:
    """Return the actor of a policy that drives a batch, as in `play`.

    Args:
        simulator: Episodes side by side.
        policy: Policy that drives them.
        deterministic: Whether the policy takes its best action.
    """
    if not deterministic and isinstance(policy, SoftPolicy):
        return SoftActor(policy, simulator)
    if isinstance(policy, ConstantPolicy):
        return always(policy)
    return PolicyActor(policy, simulator, deterministic)


def always(policy: ConstantPolicy) -> Actor:
    """Return the actor of one action, which need not be one that policies have."""
    action = np.asarray(policy.action)
    ones = (1,) * action.ndim
    return ScriptedActor(lambda _, __, rows: np.tile(action, (len(rows), *ones)))


def observations_of(
    simulator: Simulator, policy: Policy, seeds: Sequence[int] | np.ndarray
) -> np.ndarray:
    """Return what a policy observes in each decision of one episode for each seed.

    Args:
        simulator: Episodes side by side.
        policy: Policy that drives them.
        seeds: Seed of each episode.

    Returns:
        A row for each decision of a running episode, in the order of the decisions.
    """
    watched = Watched(policy, np.copy)
    for _ in play(simulator, watched, seeds):
        pass
    return np.concatenate(watched.kept)


class _Stateless:
    """Actor without a memory of an episode."""

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Begin episodes, which changes no state of the actor.

        Args:
            rows: Numbers of the rows in which episodes begin.
            seeds: Seed of each of these episodes.
        """


class Watched:
    """A policy that notes something of each observation; another one decides where that is true.

    The other policy, the fallback, gets as many features as it names, or all. If it names one more
    than the policy, it observes the time too.

    Attributes:
        noted: Of all rows of the last call.
        kept: Of the rows whose episodes were running, an array for each decision of `PolicyActor`.
    """

    def __init__(
        self, policy: Any, note: Callable[[np.ndarray], np.ndarray], fallback: Policy | None = None
    ) -> None:
        self._policy = policy
        self._note = note
        self._fallback = fallback
        self._own = getattr(policy, "n_features", None)
        further = getattr(fallback, "n_features", None)
        self.n_features = further if self._own and further == self._own + 1 else self._own
        self.remembers = getattr(policy, "remembers", False)
        self.noted = np.zeros(0)
        self.kept = list[np.ndarray]()

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions, as `types.Policy`.

        Args:
            observation: One observation, or a row for each.
            state: Memory of the policy; None at first.
            episode_start: Whether an episode begins in each row; None if the policy needs no
                memory.
            deterministic: Whether the policy takes its best action.

        Returns:
            The actions, and the policy's next memory.
        """
        own = observation if self.n_features == self._own else observation[..., : self._own]
        self.noted = self._note(np.atleast_2d(own))
        actions, state = self._policy.predict(own, state, episode_start, deterministic)
        instead = self._instead(np.asarray(observation), actions)
        if instead is None:
            return actions, state
        rows = np.shape(observation)[:-1]
        width = (1,) * (np.ndim(actions) - len(rows))  # of continuous actions
        return np.where(self.noted.reshape((*rows, *width)), instead, actions), state

    def _instead(self, observation: np.ndarray, actions: np.ndarray) -> np.ndarray | None:  # noqa: ARG002  for subclasses
        """Return the actions where what is noted is true; None: those of the policy."""
        if self._fallback is None:
            return None
        length = getattr(self._fallback, "n_features", None)
        return self._fallback.predict(observation[..., :length])[0]

    @property
    def share(self) -> float:
        """Share of the decisions kept in which what was noted is true."""
        return float(np.concatenate(self.kept).mean())


class PolicyActor(_Stateless):
    """A policy that acts for all rows at once; a stochastic one has its own random numbers.

    If it, or its policy, `remembers`, it keeps a memory for each row, and `episode_start` marks the
    rows whose episode begins; rows whose episode has ended stay in its input. `checked` makes
    actions of an answer and the number of rows; by default numbers become int64.
    """

    def __init__(
        self,
        policy: Policy,
        simulator: Simulator,
        deterministic: bool = True,
        remembers: bool = False,
        checked: Callable[[Any, int], np.ndarray] | None = None,
    ) -> None:
        self._policy = policy
        self._simulator = simulator
        self._deterministic = deterministic
        self._checked = checked
        self._memory: Any = None
        remembers = remembers or getattr(policy, "remembers", False)
        self._begun = np.ones(simulator.size, bool) if remembers else None

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:  # noqa: ARG002
        """Note that an episode begins in each of some rows.

        Args:
            rows: Numbers of the rows.
            seeds: Not used.
        """
        if self._begun is not None:
            self._begun[rows] = True

    def decide(self, observation: Any, running: np.ndarray) -> np.ndarray:  # noqa: ARG002
        """Return the policy's actions: numbers, (row,), or continuous ones, (row, value).

        Args:
            observation: Not used; the policy is shown what the simulator's `seen_by` returns.
            running: Rows that decide; the rest get an action too, which is not used.
        """
        shown_input = self._simulator.seen_by(self._policy)
        if self._begun is None:
            answer, _ = self._policy.predict(shown_input, deterministic=self._deterministic)
        else:
            begun = self._begun
            self._begun = np.zeros(len(self._begun), bool)
            answer, self._memory = self._policy.predict(
                shown_input, self._memory, episode_start=begun, deterministic=self._deterministic
            )
        if isinstance(self._policy, Watched):
            self._policy.kept.append(self._policy.noted[running])
        if self._checked is not None:
            return self._checked(answer, len(running))
        actions = np.asarray(answer)
        return actions if actions.ndim == 2 else actions.astype(np.int64)


@runtime_checkable
class SoftPolicy(Policy, Protocol):
    """Protocol of a policy that gives its action probabilities, as `nn.q_policy.QPolicy`."""

    def probabilities(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return the probability of each action."""
        ...


class _Drawing:
    """Actor with a stream of random numbers for each episode, opened by its seed."""

    def __init__(self, size: int, salt: int) -> None:
        self._salt = salt
        self._streams = [np.random.default_rng(0)] * size

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Open the stream of each episode.

        Args:
            rows: Numbers of the rows in which episodes begin.
            seeds: Seed of each of these episodes.
        """
        for row, seed in zip(rows.tolist(), seeds.tolist(), strict=True):
            self._streams[row] = np.random.default_rng([self._salt, seed])


class SoftActor(_Drawing):
    """Draws the actions of a soft policy with uniform numbers of the episodes' seeds.

    So an episode does not depend on how many others run at the same time. (A network's float32
    products may: their last bits change with the number of rows, which changes a draw about once in
    a million decisions.)
    """

    def __init__(self, policy: SoftPolicy, simulator: Simulator) -> None:
        super().__init__(simulator.size, SOFT)
        self._policy = policy
        self._simulator = simulator
        self._uniform = np.zeros((simulator.size, BLOCK))
        self._used = np.full(simulator.size, BLOCK)

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Open the stream of each episode.

        Args:
            rows: Numbers of the rows in which episodes begin.
            seeds: Seed of each of these episodes.
        """
        super().begin(rows, seeds)
        self._used[rows] = BLOCK

    def decide(self, observation: Any, running: np.ndarray) -> Int64[np.ndarray, " row"]:  # noqa: ARG002
        """Draw an action for each row.

        Args:
            observation: Not used; the policy is shown what the simulator's `seen_by` returns.
            running: Rows that decide, whose streams go on.
        """
        for row in np.flatnonzero(running & (self._used == BLOCK)).tolist():
            self._uniform[row] = self._streams[row].random(BLOCK)
            self._used[row] = 0
        inputs = np.asarray(self._simulator.seen_by(self._policy))
        cumulative = self._policy.probabilities(inputs).cumsum(axis=1)
        column = np.minimum(self._used, BLOCK - 1)
        draws = self._uniform[np.arange(len(column)), column][:, None]
        self._used[running] += 1
        chosen = (draws >= cumulative).sum(axis=1)
        return np.minimum(chosen, cumulative.shape[1] - 1).astype(np.int64)


class UniformActor(_Drawing):
    """Draws continuous actions uniformly from [-1, 1], by the seeds of the episodes."""

    def __init__(self, action_size: int, simulator: Simulator) -> None:
        super().__init__(simulator.size, UNIFORM)
        self._action_size = action_size

    def decide(self, observation: Any, running: np.ndarray) -> Float32[np.ndarray, "row size"]:  # noqa: ARG002
        """Draw actions for the running rows; the rest get 0.

        Args:
            observation: Not used.
            running: Rows that decide.
        """
        action = np.zeros((len(running), self._action_size), np.float32)
        for row in np.flatnonzero(running).tolist():
            action[row] = self._streams[row].uniform(-1.0, 1.0, self._action_size)
        return action


class ScriptedActor(_Stateless):
    """Actions by a script (number of the decision, observation, running rows) -> actions.

    All episodes begin at once.
    """

    def __init__(self, script: Callable[[int, Any, np.ndarray], np.ndarray]) -> None:
        self._script = script
        self._time = -1

    def decide(self, observation: Any, running: np.ndarray) -> np.ndarray:
        """Return the actions of the present time.

        Args:
            observation: Observation of each row, which the script gets.
            running: Rows that decide, which the script gets.
        """
        self._time += 1
        return self._script(self._time, observation, running)


class GymActor:
    """A policy that gets one observation at a time, and keeps a state of its episode."""

    def __init__(
        self, policy: Policy, deterministic: bool = True, simulator: GymSimulator | None = None
    ) -> None:
        self._simulator = simulator
        self._policy = policy
        self._deterministic = deterministic
        self._state = None

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:  # noqa: ARG002
        """Forget the last episode.

        Args:
            rows: Not used.
            seeds: Not used.
        """
        self._state = None

    def decide(self, observation: Any, running: np.ndarray) -> Shaped[np.ndarray, "1 ..."]:  # noqa: ARG002
        """Return the policy's action on the one row.

        Args:
            observation: List with the one observation; not used with a simulator, whose `seen_by`
                tells what the policy is shown.
            running: Not used.
        """
        if self._simulator is not None:
            observation = self._simulator.seen_by(self._policy)
        action, self._state = self._policy.predict(
            observation[0], self._state, deterministic=self._deterministic
        )
        if isinstance(self._policy, Watched):
            self._policy.kept.append(self._policy.noted)
        return np.array([int(action) if np.ndim(action) == 0 else np.asarray(action)])


MOST_STEPS = 100_000
"""Of an episode in an environment; without a time limit it might never end."""


class GymStep(NamedTuple):
    """Result of a step in a Gymnasium environment; numbers are NaN if they are not reported."""

    observation: Any
    rewards: RewardPair
    ending: Int64[np.ndarray, " 1"]
    speed: float
    counted: dict[str, float]  # what the environment counts, by name
    signals: Mapping[str, float]
    # what only roads report
    classical: RewardPair = RewardPair(np.zeros(0), np.zeros(0))
    off_road: np.ndarray = np.zeros(0)
    neighbours_collided: np.ndarray = np.zeros(0)


class GymSimulator:
    """A Gymnasium environment as a simulator of one row.

    Args:
        env: With discrete actions, or arrays in [-1, 1].
        modulus: Of the seeds, since not all environments accept large ones.

    Raises:
        UserError: If the kind of actions is another one; in `step`, if an episode doesn't end.
    """

    size = 1

    def __init__(self, env: gymnasium.Env[Any, Any], modulus: int | None = None) -> None:
        space = env.action_space
        unit = isinstance(space, gymnasium.spaces.Box) and is_unit_box(space)
        if not (unit or isinstance(space, gymnasium.spaces.Discrete)):
            raise UserError(
                "only discrete actions are supported, or arrays in [-1, 1]: make the environment "
                "by make_environment, which scales them"
            )
        self._env = env
        self._modulus = modulus
        self._present = None
        self._length = 0

    @property
    def observation(self) -> list[Any]:
        """The observation as the environment gave it, in a list of one."""
        return [self._present]

    def seen_by(self, policy: Any) -> list[Any]:
        """Return the observation, or rows of road users to a policy that reads them."""
        rows = getattr(self._env.unwrapped, "shown_rows", None)
        if rows is not None and getattr(policy, "reads_rows", False):
            return [np.ravel(rows)]
        return self.observation

    def reset(self, seeds: Any = None, rows: Any = None) -> list[Any]:  # noqa: ARG002
        """Reset the environment by a seed.

        Args:
            seeds: Array whose first seed is used.
            rows: Not used.

        Returns:
            The first observation, in a list.
        """
        seed = int(seeds[0])
        self._present, _ = self._env.reset(seed=seed % self._modulus if self._modulus else seed)
        self._length = 0
        return self.observation

    def step(self, actions: Any, auto_reset: bool = False, rows: Any = None) -> GymStep:  # noqa: ARG002
        """Take a step.

        Args:
            actions: Array with the one action: a number, or a row of values.
            auto_reset: Not used; the environment is never reset here.
            rows: Not used.

        Raises:
            UserError: If the episode has not ended after `MOST_STEPS` steps.
        """
        if self._length == MOST_STEPS:
            raise UserError(
                f"an episode has not ended after {MOST_STEPS:,} steps: wrap the environment "
                "in gymnasium.wrappers.TimeLimit"
            )
        after, reward, terminated, truncated, info = self._env.step(
            actions[0] if actions.ndim > 1 else int(actions[0])
        )
        ending = Ending.of_step(terminated, truncated, info)
        pair = RewardPair.of_step(reward, info)
        speed = float(info.get("speed", np.nan))
        self._present = after
        self._length = self._length + 1
        counted = {name: info[name] for name in ("neighbours_collided",) if name in info}
        signals: dict[str, float] = info.get("signals", {})
        counted |= {name: value for name, value in signals.items() if name.endswith("_hit")}
        return GymStep(after, pair, np.array([int(ending)]), speed, counted, signals)
