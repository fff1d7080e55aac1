"""Angle that depends on the situation: what a policy that follows a rule may mean, and its losses.

With an angle α(s) for each state there are three policies, which agree for a constant angle:

- by turning: each decision is that of the best policy of the angle α(s), as if the angle stayed;
- consistent: each decision is best by α(s), given that later ones follow the rule too;
- planned: the optimum of the reward cos α(s) r_env + sin α(s) r_social.

The first two are the naive and the sophisticated planner of Strotz (1955, "Myopia and inconsistency
in dynamic utility maximization"); the third has a consequence weighed by the angle of the state in
which it falls, not of the decision that caused it. A declared rule means the first. A policy's
*decision loss* is E Σ_t [V*(s_t; α) - Q*(s_t, a_t; α)] with α = α(s_t). For a constant angle this
is the regret J* - J (performance difference: Kakade and Langford 2002, Lemma 6.1).

At the intersection no value is exact. A reference dial then decides at the angle of the situation
at each decision of a policy. Where it would decide otherwise, two copies of the simulator go on
with the dial at that angle, one after the policy's action and one after the dial's. The difference
of their scores is an unbiased estimate of V(s; α) - Q(s, a; α) of the dial's policy, and 0 where
both decide alike. At a constant angle the losses of an episode add up to the dial's score less the
policy's in it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64

from socialiq.evaluation.branching import rollouts
from socialiq.evaluation.measures import Episodes, columns_of
from socialiq.evaluation.simulate import Step, actor_of, simulate
from socialiq.mdp.horizon import horizon_optimum
from socialiq.mdp.solve import best_action
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import exact_weights, score
from socialiq.social.angle_rule import AngleRule
from socialiq.types import Policy, RewardPair
from socialiq.worlds.enumerate import Table
from socialiq.worlds.highway.batch import State
from socialiq.worlds.highway.scene_batch import Batch
from socialiq.worlds.situation import angles_of, check_rule
from socialiq.worlds.world import Actor

_COPIES = 1024  # copies of the simulator side by side

TimedPolicy = Float[np.ndarray, "time state action"]


class StateAngles(NamedTuple):
    """Angle in degrees and number of the context (`AngleRule.contexts`) of each state."""

    degrees: Float64[np.ndarray, " state"]
    context: Int64[np.ndarray, " state"]


class ContextLosses(NamedTuple):
    """Decision losses of a policy's episodes, by the context of each decision.

    Attributes:
        declared: Loss at the rule's angle, reward.
        by_angle: Loss at each candidate angle.
        decisions: Number of decisions.
    """

    declared: Float64[np.ndarray, "episode context"]
    by_angle: Float64[np.ndarray, "episode context candidate"]
    decisions: Int64[np.ndarray, "episode context"]


def state_angles(table: Table, rule: AngleRule) -> StateAngles:
    """Return the angle and the context of each state of a world, or its reachable part.

    Args:
        table: The world, or its reachable part.
        rule: Rule that gives the angle of each state.

    Raises:
        UserError: If the rule belongs to another world, or reads an unknown feature.
    """
    check_rule(rule, table.world.name, clock=False)
    return StateAngles(*angles_of(rule, table.states))


def rule_reward(table: Table, angles: StateAngles) -> Float64[np.ndarray, "state action"]:
    """Return cos α(s) r_env + sin α(s) r_social of each state and action.

    Args:
        table: The world, or its reachable part.
        angles: Angle of each state of the table.
    """
    env, social = _weights(angles.degrees)
    rewards = table.mdp.rewards
    return env[:, None] * rewards.env + social[:, None] * rewards.social


def by_turning(table: Table, angles: StateAngles) -> TimedPolicy:
    """Return the exact dial turned by a rule: in each state the optimum of the angle of that state.

    Args:
        table: The world, or its reachable part.
        angles: Angle of each state of the table.

    Returns:
        Action probabilities, which are 0 or 1.
    """
    actions = np.zeros((table.world.horizon, table.mdp.n_states), np.int64)
    for angle in np.unique(angles.degrees).tolist():
        rows = angles.degrees == angle
        actions[:, rows] = _optimum(table, angle)[0][:, rows]
    return np.eye(table.mdp.n_actions)[actions]


def planned(table: Table, angles: StateAngles) -> TimedPolicy:
    """Return the optimum of the reward that weighs each step by the angle of its state.

    Args:
        table: The world, or its reachable part.
        angles: Angle of each state of the table.

    Returns:
        Action probabilities, which are 0 or 1.
    """
    mdp = table.mdp
    horizon = table.world.horizon
    best = horizon_optimum(mdp, rule_reward(table, angles), horizon)
    return best.probabilities(mdp.n_actions)


def consistent(table: Table, angles: StateAngles) -> TimedPolicy:
    """Return the policy whose every decision is best by its own angle, given the later ones.

    By backward induction over pairs of values, as in a game of one player for each state and time.

    Args:
        table: The world, or its reachable part.
        angles: Angle of each state of the table.

    Returns:
        Action probabilities, which are 0 or 1.
    """
    mdp = table.mdp
    rows = np.arange(table.mdp.n_states)
    env, social = _weights(angles.degrees)
    after = RewardPair(np.zeros(mdp.n_states), np.zeros(mdp.n_states))
    actions = np.zeros((table.world.horizon, mdp.n_states), np.int64)
    for time in reversed(range(table.world.horizon)):
        pairs = zip(mdp.rewards, after, strict=True)
        q = RewardPair(*(reward + mdp.expected_next(values) for reward, values in pairs))
        actions[time] = best_action(env[:, None] * q.env + social[:, None] * q.social)
        after = RewardPair(*(side[rows, actions[time]] for side in q))
    return np.eye(mdp.n_actions)[actions]


def decision_loss(
    table: Table, degrees: float | Float64[np.ndarray, " state"]
) -> Float64[np.ndarray, "time state action"]:
    """Return V*(s; α) - Q*(s, a; α) >= 0 of each state and action at each time.

    Args:
        table: The world, or its reachable part.
        degrees: One angle in degrees, or that of each state.
    """
    mdp = table.mdp
    horizon = table.world.horizon
    angles = np.broadcast_to(degrees, mdp.n_states)
    losses = np.empty((horizon, mdp.n_states, mdp.n_actions))
    for angle in np.unique(angles).tolist():
        rows = angles == angle
        losses[:, rows] = _optimum(table, angle)[1][:, rows]
    return losses


class RuleMetrics(NamedTuple):
    """Exact results of a policy under a rule, means over episodes.

    Attributes:
        totals: Sums of r_env and r_social.
        weighed: Sum of the reward that weighs each step by the angle of its state.
        loss: Decision loss in each context; its sum is the regret at the declared rule.
        decisions: Number of decisions in each context.
    """

    totals: RewardPair
    weighed: float
    loss: Float64[np.ndarray, " context"]
    decisions: Float64[np.ndarray, " context"]


def evaluate_by_rule(table: Table, policy: np.ndarray, rule: AngleRule) -> RuleMetrics:
    """Evaluate a policy exactly at a rule.

    Args:
        table: The world, or its reachable part.
        policy: Action probabilities by state, or by time and state.
        rule: Rule that gives the angle of each state.

    Raises:
        UserError: If the rule belongs to another world, or reads an unknown feature.
    """
    angles = state_angles(table, rule)
    mdp = table.mdp
    running = mdp.initial
    visits = []
    for time in range(table.world.horizon):
        visits.append(running[:, None] * (policy[time] if policy.ndim == 3 else policy))
        running = mdp.arrivals(visits[time])
    visits = np.stack(visits)
    lost = (visits * decision_loss(table, angles.degrees)).sum(axis=(0, 2))
    taken = visits.sum(axis=0)
    contexts = len(rule.contexts)
    return RuleMetrics(
        totals=RewardPair(*(float((taken * side).sum()) for side in mdp.rewards)),
        weighed=float((taken * rule_reward(table, angles)).sum()),
        loss=np.bincount(angles.context, lost, contexts),
        decisions=np.bincount(angles.context, taken.sum(axis=1), contexts),
    )


def _optimum(table: Table, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return actions, (time, state), and losses, (time, state, action), of an angle's optimum."""
    mdp = table.mdp
    horizon = table.world.horizon
    reward = np.asarray(score(exact_weights(angle), mdp.rewards))
    best = horizon_optimum(mdp, reward, horizon)
    after = np.vstack([best.values[1:], np.zeros(mdp.n_states)])
    q = np.stack([reward + mdp.expected_next(values) for values in after])
    return best.actions, best.values[..., None] - q


def _weights(degrees: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return cos α and sin α of each angle, exact at multiples of 90 degrees."""
    pairs = np.array([exact_weights(angle) for angle in degrees.tolist()])
    return pairs[:, 0], pairs[:, 1]


class DecisionLosses:
    """Losses of every decision in an enumerated world, to be looked up while a policy drives.

    They are at the rule's angle, and at further candidates in degrees.
    """

    def __init__(self, table: Table, rule: AngleRule, candidates: tuple[float, ...]) -> None:
        angles = state_angles(table, rule)
        self.contexts = len(rule.contexts)
        self._context = angles.context
        self._declared = decision_loss(table, angles.degrees)
        self._by_angle = np.stack([decision_loss(table, angle) for angle in candidates], axis=-1)

    def begin(self, episodes: int) -> ContextLosses:
        """Return losses of a number of episodes, all 0, which `note` adds to."""
        return _no_losses((episodes, self.contexts), self._by_angle.shape[-1])

    def noting(self, steps: Iterator[Step], losses: ContextLosses) -> Iterator[Step]:
        """Yield the decisions of a policy, and add the losses of each to those of its episode.

        Args:
            steps: Decisions in the table's states.
            losses: Losses that are added to, as `begin` returns them.
        """
        time = np.zeros(len(losses.declared), np.int64)  # decisions from each episode's start
        for step in steps:
            episode = step.episode[step.running]
            state = step.observation[step.running]
            action = step.action[step.running]
            cell = (episode, self._context[state])
            losses.declared[cell] += self._declared[time[episode], state, action]
            losses.by_angle[cell] += self._by_angle[time[episode], state, action]
            losses.decisions[cell] += 1
            time[episode] += 1
            yield step


def _no_losses(shape: tuple[int, int], candidates: int) -> ContextLosses:
    by_angle = np.zeros((*shape, candidates))
    return ContextLosses(np.zeros(shape), by_angle, np.zeros(shape, np.int64))


def losses_of(
    batch: Batch,
    policy: Policy,
    seeds: Int64[np.ndarray, " episode"],
    reference: DialPolicy,
    rule: AngleRule,
    candidates: tuple[float, ...] = (),
    deterministic: bool = True,
) -> tuple[Episodes, ContextLosses]:
    """Run one episode of a policy for each seed, and measure its decision losses on the core.

    Args:
        batch: Episodes of the intersection, on the core.
        policy: Policy that drives.
        seeds: Seed of each episode.
        reference: Dial by whose policies the losses are measured.
        rule: Rule that gives the angle of each decision.
        candidates: Further angles at which the losses are measured, degrees.
        deterministic: Whether the policy takes its best action.

    Returns:
        Sums of the episodes, and their losses.
    """
    inner = actor_of(batch, policy, deterministic)
    actor = LossActor(batch, inner, seeds, reference, rule, candidates)
    episodes = columns_of(simulate(batch, actor, seeds), len(seeds))
    return episodes, actor.losses


class LossActor:
    """Actor that measures the loss of each decision of an inner actor before it is taken."""

    def __init__(
        self,
        batch: Batch,
        inner: Actor,
        seeds: Int64[np.ndarray, " episode"],
        reference: DialPolicy,
        rule: AngleRule,
        candidates: tuple[float, ...],
    ) -> None:
        self._batch = batch
        self._inner = inner
        self._reference = reference
        self._rule = rule
        self._candidates = np.array(candidates, np.float64)
        self._number = {seed: number for number, seed in enumerate(seeds.tolist())}
        self._episode = np.zeros(batch.size, np.int64)
        self._copies = batch.like(_COPIES)
        self.losses = _no_losses((len(seeds), len(rule.contexts)), len(candidates))

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Note which episode begins in each of some rows.

        Args:
            rows: Numbers of the rows.
            seeds: Seed of the episode of each of these rows.
        """
        self._inner.begin(rows, seeds)
        self._episode[rows] = [self._number[seed] for seed in seeds.tolist()]

    def decide(
        self, observation: np.ndarray, running: Bool[np.ndarray, " row"]
    ) -> Int64[np.ndarray, " row"]:
        """Return the inner actor's actions.

        Args:
            observation: Observation of each row.
            running: Rows that decide, whose losses are measured.
        """
        action = self._inner.decide(observation, running)
        rows = np.flatnonzero(running)
        degrees, context = angles_of(self._rule, observation[rows], self._batch.time[rows])
        angles = np.column_stack([degrees, np.tile(self._candidates, (len(rows), 1))])
        count, columns = angles.shape
        inputs = np.repeat(self._batch.seen_by(self._reference)[rows], columns, axis=0)
        best = self._reference.q_values_at(inputs, angles.ravel()).argmax(axis=1)
        state = self._batch.save().rows(rows)
        origin = np.repeat(np.arange(count), columns)
        same = self._batch.equivalent_actions[rows][origin]
        taken = action[rows][origin]
        cells = np.arange(len(origin))
        lost = np.zeros(len(origin))
        differing = np.flatnonzero(same[cells, taken] != same[cells, best])
        for first in range(0, len(differing), _COPIES // 2):
            chosen = differing[first : first + _COPIES // 2]
            pairs = np.concatenate([best[chosen], taken[chosen]])
            turned = np.tile(angles.ravel()[chosen], 2)
            values = self._played(state.rows(np.tile(origin[chosen], 2)), pairs, turned)
            lost[chosen] = values[: len(chosen)] - values[len(chosen) :]
        lost = lost.reshape(count, columns)
        cell = self._episode[rows], context
        np.add.at(self.losses.declared, cell, lost[:, 0])
        np.add.at(self.losses.by_angle, cell, lost[:, 1:])
        np.add.at(self.losses.decisions, cell, 1)
        return action

    def _played(
        self, state: State, action: np.ndarray, angles: Float64[np.ndarray, " copy"]
    ) -> Float64[np.ndarray, " copy"]:
        """Return the score of a first action and the reference's further ones, at given angles."""
        copies = self._copies
        used = len(action)
        copies.restore(state.rows(np.arange(copies.size) % used))
        turned = np.resize(angles, copies.size)
        radians = np.deg2rad(turned)
        total = np.zeros(copies.size)

        def follow(rows: np.ndarray) -> np.ndarray:
            observation = copies.seen_by(self._reference)[rows]
            return self._reference.q_values_at(observation, turned[rows]).argmax(axis=1)

        running = np.arange(copies.size) < used
        for decided, decisions in rollouts(copies, np.resize(action, copies.size), running, follow):
            scored = (
                np.cos(radians) * decisions.rewards.env + np.sin(radians) * decisions.rewards.social
            )
            total[decided] += scored[decided]
        return total[:used]
