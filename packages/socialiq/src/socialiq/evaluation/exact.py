"""Metrics of thesis 5.4, and exact evaluation in an enumerable world, without sampling noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import angle_of, exact_weights, score, weights
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.registry import make_grid

if TYPE_CHECKING:
    from socialiq.learners.dial.train import Regret

Readout = Literal["greedy", "soft"]

READOUTS: tuple[Readout, ...] = ("greedy", "soft")


class Metrics(NamedTuple):
    """Means over episodes: sums of both rewards, shares of endings, number of steps.

    Attributes:
        angle: α̂ in degrees, of the rewards' means.
        mean_speed: Cells (or metres) per step, over all steps.
        stopped: Share of steps at speed 0.
    """

    r_env: float
    r_social: float
    angle: float
    collision: float
    arrival: float
    timeout: float
    mean_speed: float
    stopped: float
    length: float

    @staticmethod
    def of(
        totals: RewardPair,
        endings: Float[np.ndarray, " kind"],
        mean_speed: float,
        stopped: float,
        length: float,
    ) -> Metrics:
        """Build metrics from mean totals and the share of each `Ending`.

        Args:
            totals: Mean sums of r_env and r_social of an episode.
            endings: Share of episodes by the value of `Ending`.
            mean_speed: Cells (or metres) per step, over all steps.
            stopped: Share of steps at speed 0.
            length: Mean number of steps.
        """
        env = float(totals.env)
        social = float(totals.social)
        kinds = (Ending.COLLISION, Ending.ARRIVAL, Ending.TIMEOUT)
        collision, arrival, timeout = (float(endings[kind]) for kind in kinds)
        means = (float(mean_speed), float(stopped), float(length))
        return Metrics(env, social, angle_of(env, social), collision, arrival, timeout, *means)

    @property
    def totals(self) -> RewardPair:
        """Mean reward totals as a pair."""
        return RewardPair(self.r_env, self.r_social)

    def value(self, angle: float) -> float:
        """Return J(α), the mean total scored at an angle in degrees (Eq 4.3)."""
        return float(score(weights(angle), self.totals))


def mean_of(metrics: list[Metrics]) -> Metrics:
    """Average metrics over training seeds; the angle is that of the mean totals."""
    mean = Metrics(*np.mean(np.array(metrics), axis=0).tolist())
    return mean._replace(angle=angle_of(mean.r_env, mean.r_social))


def evaluate_exactly(
    table: Table,
    policy: Float[np.ndarray, "state action"] | Float[np.ndarray, "time state action"],
) -> Metrics:
    """Propagate the state distribution of action probabilities over one episode of the horizon.

    Args:
        table: The world, or its reachable part.
        policy: Action probabilities by state, or by time and state.
    """
    result = horizon_evaluation(table.mdp, policy, table.world.horizon)
    share = result.visits / result.length
    speed = float((share * table.speed).sum())
    stopped = float(share[table.speed == 0].sum())
    return Metrics.of(result.totals, result.endings, speed, stopped, result.length)


class Optimum:
    """Optimum J*(α) of a world, or its reachable part: of any policy, also time-dependent."""

    def __init__(self, table: Table) -> None:
        self.attainable: AttainableSet = attainable_set(table.mdp, table.world.horizon)

    def regret(self, metrics: Metrics, angle: float) -> float:
        """Return the regret J*(α) - J(α) >= 0 of a policy.

        Args:
            metrics: Exact metrics of the policy.
            angle: The angle α in degrees.
        """
        return self.attainable.optimum(angle).value - metrics.value(angle)


@lru_cache(maxsize=8)
def optimum_of(world: GridWorld) -> Optimum:
    """Return the optimum of a gridworld, computed once."""
    return Optimum(tabulate(world).reachable_part())


@lru_cache(maxsize=8)
def optima_of(world: GridWorld) -> list[tuple[tuple[float, float], np.ndarray, RewardPair]]:
    """Return the optimum at each vertex of what a gridworld's policies attain.

    It is given by the angles at which it is best, its actions (time, state), and its expected
    totals.
    """
    mdp = tabulate(world).reachable_part().mdp
    horizon = world.horizon
    optima = []
    attainable = optimum_of(world).attainable
    for vertex in range(len(attainable.vertices)):
        low, high = attainable.supporting_interval(vertex)
        reward = np.asarray(score(exact_weights((low + high) / 2), mdp.rewards))
        best = horizon_optimum(mdp, reward, horizon)
        totals = horizon_evaluation(mdp, best.probabilities(mdp.n_actions), horizon).totals
        optima.append(((low, high), best.actions, totals))
    return optima


class Ground(NamedTuple):
    """A gridworld with its exact optima.

    Attributes:
        table: All its states.
        part: Its reachable states.
        optimum: The best that any policy can do in it, by angle.
    """

    table: Table
    part: Table
    optimum: Optimum

    @staticmethod
    def of(world: str) -> Ground:
        """Enumerate a world with its default options."""
        table = tabulate(make_grid(world))
        return Ground(table, table.reachable_part(), optimum_of(table.world))

    def with_clock(self, clock: bool) -> Ground:
        """Return the ground with the time in the observations, or unchanged."""
        if not clock:
            return self
        table, part = (
            dataclasses.replace(states, world=states.world.with_clock())
            for states in (self.table, self.part)
        )
        return Ground(table, part, self.optimum)

    def regret(self, policy: SoftPolicy, angle: float, readout: Readout) -> float:
        """Return the regret of a policy at an angle.

        Args:
            policy: Policy that gives its action probabilities.
            angle: The angle in degrees.
            readout: "greedy" for the best action, "soft" for the probabilities.
        """
        chances = action_table(policy, self.part, readout)
        return self.optimum.regret(evaluate_exactly(self.part, chances), angle)


def exact_regret(
    ground: Ground, static: Any, numbers: Sequence[Any], readout: Readout = "soft"
) -> Regret:
    """Return the regret of a dial's run at the angle of its config, for `learners.dial.Budget`.

    The default is the soft policy: its regret falls smoothly with the multiplier, a greedy policy's
    in jumps, so that no multiplier may meet a budget.

    Args:
        ground: The gridworld, with the clock if the dial observes the time.
        static: Static configuration of the dial, whose `low` is the angle.
        numbers: Hyperparameters of each run.
        readout: "greedy" for the best action, "soft" for the probabilities.

    Returns:
        A function of the network, the number of the run and the multiplier.
    """
    from socialiq.learners.dial.train import dial_of  # learning needs JAX

    def regret(network: Any, run: int, multiplier: float) -> float:
        policy: Any = dial_of(static, numbers[run], network, multiplier)
        return ground.regret(policy.at(static.low), static.low, readout)

    return regret


def action_table(
    policy: Policy, table: Table, readout: Readout
) -> Float[np.ndarray, "*time state action"]:
    """Return a policy's action probabilities in every state, with a clock at every time.

    Args:
        policy: The policy; for "soft" a `SoftPolicy`.
        table: The world, or its reachable part.
        readout: "greedy" for the best action, "soft" for the policy's probabilities.

    Raises:
        UserError: If the readout is unknown, or the policy gives no probabilities for "soft".
    """
    one_of("readout", readout, READOUTS)
    observation = table.observations()
    if readout == "soft":
        if not isinstance(policy, SoftPolicy):
            raise UserError("this policy gives no probabilities: leave --soft out")
        chances = policy.probabilities(observation)
    else:
        chances = np.eye(table.world.n_actions)[policy.predict(observation)[0]]
    by_time = chances.reshape(-1, table.mdp.n_states, table.world.n_actions)
    return by_time if table.world.clock else by_time[0]


def exact_monitor(
    table: Table, temperatures: Sequence[float]
) -> Callable[[Any], dict[str, np.ndarray]]:
    """Return a monitor for `learners.callbacks.Callbacks`: metrics of each run, greedy and soft.

    Args:
        table: The world; its reachable part is faster.
        temperatures: Temperature τ of each run.

    Returns:
        A function of the training's state. It returns a value for each run by the name of the
        readout and the metric, as "greedy_r_env".
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


def visit_counts(data: Demonstrations, table: Table) -> Float[np.ndarray, "time state action"]:
    """Return counts of each action by time and state, of demonstrations with or without the clock.

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
    np.add.at(counts, (data.step, rows, data.action), 1.0)
    return counts
