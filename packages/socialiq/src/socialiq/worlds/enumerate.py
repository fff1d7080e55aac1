"""Exact transition table of a gridworld, and episodes in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int, Int8, Int64

from socialiq.errors import UserError
from socialiq.foreign import Later
from socialiq.mdp.tabular import TabularMDP
from socialiq.types import Ending, RewardPair
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.world import observed_with_time, rows_of, with_time

if TYPE_CHECKING:
    from socialiq.worlds.grid_world import GridWorld, Outcome

jax: Any = Later("jax")
jnp: Any = Later("jax.numpy")

_CHANCE = 5190  # makes draws of chance independent of other draws from the same seed


@dataclass(frozen=True)
class Table:
    """Enumerated world: its MDP, and the quantities of each state and action for evaluation."""

    world: GridWorld
    mdp: TabularMDP  # exact transitions and expected reward pair, float64
    states: Int[np.ndarray, "state feature"]  # of each index
    speed: Float[np.ndarray, "state action"]  # expected, of the ego, cells per step
    signals: dict[str, Float[np.ndarray, "state action"]]  # expected value of each named signal

    def observe(
        self, state: Int[np.ndarray, " row"], time: Int[np.ndarray, " row"]
    ) -> Float32[np.ndarray, "row feature"]:
        """Return the observations of states.

        Args:
            state: Index of each state in this table.
            time: Steps since the start; it is observed only if the world has a clock.
        """
        return with_time(self.states[state], time, self.world.clock).astype(np.float32)

    def observations(self) -> Float32[np.ndarray, "row feature"]:
        """Return the observation of every state; with a clock of every time and state."""
        times = self.world.horizon if self.world.clock else 1
        time, state = np.divmod(np.arange(times * self.mdp.n_states), self.mdp.n_states)
        return self.observe(state, time)

    def reachable_part(self) -> Table:
        """Return the table restricted to the states that some policy can reach."""
        mdp, reachable = self.mdp.reachable_part()
        signals = {name: value[reachable] for name, value in self.signals.items()}
        return Table(self.world, mdp, self.states[reachable], self.speed[reachable], signals)


def tabulate(world: GridWorld) -> Table:
    """Run the rules on every state, action and chance outcome.

    Rewards are weighted in float64 from the signals, which are exact in float32.
    """
    if not hasattr(world, "chance"):
        raise UserError(f"{type(world).__name__} is no gridworld: make one by make('crossing7')")
    states = world.states()
    outcome = _outcomes(world)
    chance = np.asarray(world.chance, np.float64)

    def expected(values: Any) -> Float[np.ndarray, "state action"]:
        """Return means over chance; a value that no chance changes has no rounding."""
        values = np.asarray(values, np.float64)
        return values[..., 0] + (values - values[..., :1]) @ chance

    signals = {name: expected(value) for name, value in outcome.signals.items()}
    initial = np.zeros(len(states))
    for state, probability in world.start:
        initial[world.index(state)] += probability
    ending = np.asarray(outcome.ending, np.int32)
    mdp = TabularMDP(
        successor=world.index(outcome.state).astype(np.int32),
        probability=np.broadcast_to(chance, ending.shape).copy(),
        ending=ending,
        rewards=world.rewards(signals),
        initial=initial,
    )
    return Table(world, mdp, states, expected(outcome.speed), signals)


@lru_cache(maxsize=64)
def episode_range(world: GridWorld, weights: tuple[float, float]) -> tuple[float, float]:
    """Return the smallest and the largest weighted sum of an episode's rewards, exactly.

    The limits hold for every episode of every driver, and each is reached in some episode. They are
    computed by dynamic programming over all actions and all possible chance outcomes.

    Args:
        world: World of the episodes.
        weights: Weights of r_env and of r_social.
    """
    outcome = _outcomes(world)
    possible = np.asarray(world.chance) > 0.0
    signals = {name: np.asarray(values, np.float64) for name, values in outcome.signals.items()}
    rewards = world.rewards(signals)
    reward = (weights[0] * rewards.env + weights[1] * rewards.social)[..., possible]
    successor = world.index(outcome.state)[..., possible]
    goes_on = (np.asarray(outcome.ending) == Ending.NONE)[..., possible]
    first = [world.index(state) for state, probability in world.start if probability > 0.0]
    ends = []
    for extreme in (np.min, np.max):
        value = np.zeros(len(world.states()))
        for _ in range(world.horizon):
            value = extreme(reward + np.where(goes_on, value[successor], 0.0), axis=(1, 2))
        ends.append(float(extreme(value[first])))
    return ends[0], ends[1]


def _outcomes(world: GridWorld) -> Outcome:
    """Return the outcome of every state, action and chance outcome."""
    actions = jnp.arange(world.n_actions)
    chances = jnp.arange(len(world.chance))
    return _all_outcomes(world.rules)(world.states(), actions, chances)


@cache  # compiled once for the same rules
def _all_outcomes(rules: Callable[..., Outcome]) -> Any:
    each_chance = jax.vmap(rules, in_axes=(None, None, 0))
    each_action = jax.vmap(each_chance, in_axes=(None, 0, None))
    return jax.jit(jax.vmap(each_action, in_axes=(0, None, None)))


class GridStep(NamedTuple):
    """Result of a step in a gridworld, of all rows."""

    observation: Int64[np.ndarray, " row"]  # index of the state reached
    rewards: RewardPair  # rewards of the step
    ending: Int64[np.ndarray, " row"]  # values of `Ending`; a timeout after the horizon's last step
    contact: Int8[np.ndarray, " row"]  # values of `Contact`: the ego struck, if it collided


class GridState(NamedTuple):
    """Complete state of some episodes: index, time, chance to come, and whether they have ended."""

    state: Int64[np.ndarray, " row"]
    time: Int64[np.ndarray, " row"]
    fate: Float[np.ndarray, "row draw"]
    waiting: np.ndarray

    def rows(self, chosen: Any) -> GridState:
        """Return the state of the chosen episodes; indices may repeat."""
        return GridState(*(column[chosen].copy() for column in self))


class GridBatch:
    """Episodes of a gridworld side by side (`world.Batch`).

    The seed of an episode determines its first state and every chance outcome; a shared generator
    in its place is one source for all of them. The table may be that of the reachable part.
    """

    def __init__(self, table: Table, size: int, shared: np.random.Generator | None = None) -> None:
        self.table = table
        self.size = size
        self._shared = shared
        self.state = np.zeros(size, np.int64)
        self._time = np.zeros(size, np.int64)
        self._fate = np.zeros((size, table.world.horizon + 1))
        self._waiting = np.ones(size, bool)
        self._last_seeds = np.zeros(0, np.int64)
        self._last_fate = np.zeros((0, 1))

    @property
    def observation(self) -> Int64[np.ndarray, " row"]:
        """Index of the present state of each episode; one that is over stays in its last."""
        return self.state.copy()

    @property
    def time(self) -> Float32[np.ndarray, " row"]:
        """Steps since the last reset of every episode."""
        return self._time.astype(np.float32)

    def seen_by(self, policy: Any) -> Float32[np.ndarray, "row feature"]:
        """Return the observations, with the time at the end if a policy has one feature more."""
        return observed_with_time(self.table.observe(self.state, self._time), self.time, policy)

    def reset(self, seeds: Any = None, rows: Any = None) -> Int64[np.ndarray, " row"]:
        """Draw the first states of some rows.

        Args:
            seeds: A seed for each of these rows. They are not used if the batch has a shared
                generator.
            rows: Rows, by numbers or as a mask; None: all.

        Returns:
            The index of the state of each row.

        Raises:
            UserError: If seeds are needed and missing.
        """
        chosen = np.flatnonzero(rows_of(rows, self.size))
        initial = self.table.mdp.initial
        if self._shared is not None:
            self.state[chosen] = self._shared.choice(len(initial), size=len(chosen), p=initial)
        else:
            if seeds is None:
                raise UserError("every reset of a gridworld needs its seeds")
            seeds = np.asarray(seeds)
            if not np.array_equal(seeds, self._last_seeds):  # else as for the driver before
                # Uniform numbers decide the first state and each outcome of an episode.
                streams = [np.random.default_rng([_CHANCE, seed]) for seed in seeds.tolist()]
                self._last_fate = np.array([rng.random(self._fate.shape[1]) for rng in streams])
                self._last_seeds = seeds.copy()
            self._fate[chosen] = self._last_fate
            ends = initial.cumsum()  # once, as `drawn_outcome` would for each row
            index = np.searchsorted(ends, self._fate[chosen, 0], side="right")
            self.state[chosen] = np.minimum(index, len(ends) - 1)
        self._time[chosen] = 0
        self._waiting[chosen] = False
        return self.observation

    def step(self, actions: Any, auto_reset: bool = False, rows: Any = None) -> GridStep:
        """Take a step in some rows.

        Args:
            actions: Number of an action for each row of the batch; those of rows that take no step
                are not used.
            auto_reset: Must be False: a reset needs seeds.
            rows: Rows that take a step, by numbers or as a mask; None: all.

        Returns:
            Results of all rows; rewards and ending are 0 where no step was taken.
        """
        assert not auto_reset
        mdp = self.table.mdp
        chosen = np.flatnonzero(rows_of(rows, self.size))
        state = self.state[chosen]
        action = np.asarray(actions)[chosen]
        chances = mdp.probability[state, action]
        if self._shared is None:
            outcome = drawn_outcome(chances, self._fate[chosen, self._time[chosen] + 1])
        else:
            outcome = drawn_outcome(chances, self._shared.random(len(chosen)))
        after = mdp.successor[state, action, outcome]
        ending = mdp.ending[state, action, outcome]
        self._time[chosen] += 1
        late = (ending == Ending.NONE) & (self._time[chosen] == self.table.world.horizon)
        ending = np.where(late, int(Ending.TIMEOUT), ending)
        self.state[chosen] = np.where((ending == Ending.NONE) | late, after, state)
        self._waiting[chosen] = ending != Ending.NONE
        reached = self.observation
        endings = np.zeros(self.size, np.int64)
        reached[chosen] = after
        endings[chosen] = ending
        pair = RewardPair(np.zeros(self.size), np.zeros(self.size))
        for side, reward in zip(pair, mdp.rewards, strict=True):
            side[chosen] = reward[state, action]
        struck = np.where(endings == Ending.COLLISION, int(Contact.EGO_STRUCK), int(Contact.NONE))
        return GridStep(reached, pair, endings, struck.astype(np.int8))

    def save(self) -> GridState:
        """Return a copy of the state of every episode."""
        return GridState(self.state, self._time, self._fate, self._waiting).rows(slice(None))

    def restore(self, state: GridState) -> None:
        """Restore a saved state with as many rows."""
        columns = (self.state, self._time, self._fate, self._waiting)
        for column, saved in zip(columns, state, strict=True):
            column[:] = saved

    def branch(self, rows: Any) -> GridBatch:
        """Return a batch of copies of some episodes, which may repeat; this one is not changed."""
        copies = GridBatch(self.table, len(rows), self._shared)
        copies.restore(self.save().rows(rows))
        return copies


def drawn_outcome(
    chances: Float[np.ndarray, "row outcome"], uniform: Float[np.ndarray, " row"]
) -> Int64[np.ndarray, " row"]:
    """Return the outcome that a uniform number of each row stands for."""
    outcome = (uniform[:, None] >= chances.cumsum(axis=1)).sum(axis=1)
    return np.minimum(outcome, chances.shape[1] - 1)
