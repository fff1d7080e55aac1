"""Exact evaluation in an enumerable world, without sampling noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.evaluation.metrics import Metrics
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.mdp.horizon import horizon_evaluation
from socialiq.nn.q_policy import QPolicy, ValuePolicy
from socialiq.worlds.enumerate import Table

Readout = Literal["greedy", "soft"]

READOUTS: tuple[Readout, ...] = ("greedy", "soft")


def evaluate_exactly(
    table: Table,
    policy: Float[np.ndarray, "state action"] | Float[np.ndarray, "time state action"],
) -> Metrics:
    """Propagate the state distribution over one episode of the world's horizon.

    Args:
        table: The world, or its reachable part.
        policy: Action probabilities in the table's states, stationary or by time.
    """
    result = horizon_evaluation(table.mdp, policy, table.world.horizon)
    share = result.visits / result.length
    return Metrics.of(
        totals=result.totals,
        endings=result.endings,
        mean_speed=float((share * table.speed).sum()),
        stopped=float(share[table.speed == 0].sum()),
        length=result.length,
    )


class Optimum:
    """Optimum J*(α) of a world: the largest mean total of any policy, also time-dependent.

    Args:
        table: The world, or its reachable part.
    """

    def __init__(self, table: Table) -> None:
        self.attainable: AttainableSet = attainable_set(table.mdp, table.world.horizon)

    def regret(self, metrics: Metrics, angle: float) -> float:
        """Return the regret J*(α) - J(α) >= 0 of a policy; angle in degrees."""
        return self.attainable.optimum(angle).value - metrics.value(angle)


def action_table(
    policy: ValuePolicy, table: Table, readout: Readout
) -> Float[np.ndarray, "*time state action"]:
    """Return a network's action probabilities in every state, or time and state, of a table.

    Args:
        policy: The network.
        table: The world, or its reachable part.
        readout: "greedy" takes the best action, "soft" the distribution softmax(Q/τ).

    Returns:
        Probabilities by state; if the world has a clock, by time and state.
    """
    one_of("readout", readout, READOUTS)
    times = np.arange(table.world.horizon if table.world.clock else 1)
    time, state = np.divmod(np.arange(len(times) * table.mdp.n_states), table.mdp.n_states)
    observation = table.observe(state, time)
    if readout == "soft":
        chances = policy.probabilities(observation)
    else:
        chances = np.eye(policy.n_actions)[policy.q_values(observation).argmax(axis=1)]
    by_time = chances.reshape(len(times), table.mdp.n_states, policy.n_actions)
    return by_time if table.world.clock else by_time[0]


def exact_monitor(
    table: Table, temperatures: Sequence[float]
) -> Callable[[Any], dict[str, np.ndarray]]:
    """Return a monitor for `learners.callbacks.Callbacks`: metrics of each run, greedy and soft.

    Args:
        table: The world, or (faster) its reachable part.
        temperatures: τ of each run.
    """
    from socialiq.nn.q_network import network_of  # learning needs JAX

    def monitor(state: Any) -> dict[str, np.ndarray]:
        values: dict[str, list[float]] = {}
        for run, temperature in enumerate(temperatures):
            policy = QPolicy.of(network_of(state.network, run), temperature, {})
            for readout in READOUTS:
                metrics = evaluate_exactly(table, action_table(policy, table, readout))
                for name, value in metrics._asdict().items():
                    values.setdefault(f"{readout}_{name}", []).append(value)
        return {name: np.array(column) for name, column in values.items()}

    return monitor


def visit_counts(
    data: Demonstrations, table: Table, values: Float[np.ndarray, " transition"] | None = None
) -> Float[np.ndarray, "time state action"]:
    """Return counts of each action by time and state, or sums of values.

    Args:
        data: Demonstrations in the table's world, with or without its clock.
        table: The world or its reachable part.
        values: Values to sum instead of counting.

    Raises:
        UserError: If a state is not in the table, or an episode is longer than the horizon.
    """
    features = len(table.world.features)
    places = {state.tobytes(): number for number, state in enumerate(table.states)}
    states = data.observation[:, :features].astype(table.states.dtype)
    rows = np.array([places.get(state.tobytes(), -1) for state in states])
    if (rows < 0).any() or data.step.max() >= table.world.horizon:
        raise UserError(f"the demonstrations are not of {table.world.description}")
    counts = np.zeros((table.world.horizon, table.mdp.n_states, table.mdp.n_actions))
    np.add.at(counts, (data.step, rows, data.action), 1.0 if values is None else values)
    return counts
