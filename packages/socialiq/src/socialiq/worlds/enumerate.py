"""Exact transition table of a gridworld, enumerated from its rules."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32, Int

from socialiq.mdp.tabular import TabularMDP
from socialiq.types import Ending
from socialiq.worlds.grid_world import GridWorld, Outcome


@dataclass(frozen=True)
class Table:
    """Enumerated world: its MDP, and the quantities of each state and action for evaluation.

    Attributes:
        world: The world.
        mdp: Exact transitions and expected reward pair, float64.
        states: The state of each index.
        speed: Expected ego speed in cells per step.
        signals: Expected value of each named signal.
    """

    world: GridWorld
    mdp: TabularMDP
    states: Int[np.ndarray, "state feature"]
    speed: Float[np.ndarray, "state action"]
    signals: dict[str, Float[np.ndarray, "state action"]]

    def observe(
        self, state: Int[np.ndarray, " row"], time: Int[np.ndarray, " row"]
    ) -> Float32[np.ndarray, "row feature"]:
        """Return the observations of the states with these indices at these times."""
        seen = self.states[state]
        return (np.column_stack([seen, time]) if self.world.clock else seen).astype(np.float32)

    def reachable_part(self) -> Table:
        """Return the table restricted to the states that some policy can reach."""
        part, kept = self.mdp.reachable_part()
        signals = {name: value[kept] for name, value in self.signals.items()}
        return Table(self.world, part, self.states[kept], self.speed[kept], signals)


def tabulate(world: GridWorld) -> Table:
    """Run the rules on every state, action and chance outcome.

    Rewards are weighted in float64 from the signals, which are exact in float32.
    """
    states, outcome = world.states(), _outcomes(world)
    chance = np.asarray(world.chance, np.float64)
    signals = {
        name: np.asarray(value, np.float64) @ chance for name, value in outcome.signals.items()
    }
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
    return Table(world, mdp, states, np.asarray(outcome.speed, np.float64) @ chance, signals)


@lru_cache(maxsize=64)
def episode_range(world: GridWorld, weights: tuple[float, float]) -> tuple[float, float]:
    """Return the smallest and the largest weighted sum of an episode's rewards, exactly.

    By dynamic programming over all actions and all possible chance outcomes: limits of every
    driver's every episode, and each is reached in some episode.

    Args:
        world: The world.
        weights: Weights of r_env and r_social.
    """
    outcome, possible = _outcomes(world), np.asarray(world.chance) > 0.0
    signals = {name: np.asarray(one, np.float64) for name, one in outcome.signals.items()}
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
    actions, chances = jnp.arange(world.n_actions), jnp.arange(len(world.chance))
    return _all_outcomes(world.rules, world.states(), actions, chances)


@partial(jax.jit, static_argnums=0)  # compiled once for the same rules
def _all_outcomes(rules: Callable[..., Outcome], states: Any, actions: Any, chances: Any) -> Any:
    each_chance = jax.vmap(rules, in_axes=(None, None, 0))
    each_action = jax.vmap(each_chance, in_axes=(None, 0, None))
    return jax.vmap(each_action, in_axes=(0, None, None))(states, actions, chances)
