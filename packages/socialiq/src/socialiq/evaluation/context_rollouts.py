"""Decision loss at a rule of the angle at the intersection, by rollouts in copies of the simulator.

At each decision of a policy a reference dial is asked at the angle of the situation. Where it would
decide otherwise, two copies of the simulator go on with the dial at that angle, one after the
policy's action and one after the dial's. The difference of their scores is an unbiased estimate of
V(s; α) - Q(s, a; α) of the dial's policy (`evaluation.context`), and 0 where both decide alike. At
a constant angle the losses of an episode add up to the dial's score less the policy's in it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, Int64

from socialiq.evaluation.branching import equivalent_actions
from socialiq.evaluation.context import ContextLosses
from socialiq.evaluation.episodes import Episodes, summed
from socialiq.evaluation.play import BatchSimulator, actor_of
from socialiq.evaluation.simulate import Actor, simulate
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle_rule import AngleRule
from socialiq.types import Ending, Policy
from socialiq.worlds.highway.episodes import State
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.situation import angles_of

_COPIES = 1024  # copies of the simulator side by side


def losses_of(
    batch: Batch,
    policy: Policy,
    seeds: Int64[np.ndarray, " episode"],
    reference: DialPolicy,
    rule: AngleRule,
    candidates: tuple[float, ...] = (),
    deterministic: bool = True,
) -> tuple[Episodes, ContextLosses]:
    """Run one episode of a policy for each seed, and measure its decision losses.

    Args:
        batch: Batch of episodes to drive, on the core.
        policy: The policy.
        seeds: Seed of each episode, each once.
        reference: Dial that the policy is compared with.
        rule: The rule.
        candidates: Further angles at which the losses are measured, in degrees.
        deterministic: Whether the policy takes its best action.
    """
    inner = actor_of(batch, policy, deterministic)
    actor = LossActor(batch, inner, seeds, reference, rule, candidates)
    episodes = summed(simulate(BatchSimulator(batch), actor, seeds), len(seeds))
    return episodes, actor.losses


class LossActor:
    """Actor that measures the loss of each decision of another one before it is taken.

    Attributes:
        losses: The losses so far.
    """

    def __init__(
        self,
        batch: Batch,
        inner: Actor,
        seeds: Int64[np.ndarray, " episode"],
        reference: DialPolicy,
        rule: AngleRule,
        candidates: tuple[float, ...],
    ) -> None:
        self._batch, self._inner, self._reference, self._rule = batch, inner, reference, rule
        self._candidates = np.array(candidates, np.float64)
        self._number = {seed: number for number, seed in enumerate(seeds.tolist())}
        self._episode = np.zeros(batch.size, np.int64)
        self._copies = Batch(batch.options, _COPIES)
        shape = (len(seeds), len(rule.contexts))
        self.losses = ContextLosses(
            np.zeros(shape), np.zeros((*shape, len(candidates))), np.zeros(shape, np.int64)
        )

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Note which episode begins in each of some rows."""
        self._inner.begin(rows, seeds)
        self._episode[rows] = [self._number[seed] for seed in seeds.tolist()]

    def decide(
        self, observation: np.ndarray, running: Bool[np.ndarray, " row"]
    ) -> Int64[np.ndarray, " row"]:
        """Return the other actor's actions."""
        action = self._inner.decide(observation, running)
        rows = np.flatnonzero(running)
        degrees, context = angles_of(self._rule, observation[rows], self._batch.time[rows])
        wanted = np.column_stack([degrees, np.tile(self._candidates, (len(rows), 1))])
        lost = self._lost(rows, wanted, action[rows])
        place = (self._episode[rows], context)
        np.add.at(self.losses.declared, place, lost[:, 0])
        np.add.at(self.losses.by_angle, place, lost[:, 1:])
        np.add.at(self.losses.decisions, place, 1)
        return action

    def _lost(
        self, rows: np.ndarray, wanted: Float64[np.ndarray, "row angle"], action: np.ndarray
    ) -> Float64[np.ndarray, "row angle"]:
        """Return the loss of each row's action at each of its angles."""
        count, angles = len(rows), wanted.shape[1]
        seen = np.repeat(self._batch.seen_by(self._reference)[rows], angles, axis=0)
        best = self._reference.q_values_at(seen, wanted.ravel()).argmax(axis=1)
        state, each = self._batch.save().rows(rows), np.repeat(np.arange(count), angles)
        same = equivalent_actions(state, self._batch.options)[each]
        taken, one = action[each], np.arange(len(each))
        found = np.zeros(len(each))
        others = np.flatnonzero(same[one, taken] != same[one, best])
        for first in range(0, len(others), _COPIES // 2):
            some = others[first : first + _COPIES // 2]
            pairs = np.concatenate([best[some], taken[some]])
            turned = np.tile(wanted.ravel()[some], 2)
            values = self._played(state.rows(np.tile(each[some], 2)), pairs, turned)
            found[some] = values[: len(some)] - values[len(some) :]
        return found.reshape(count, angles)

    def _played(
        self, state: State, action: np.ndarray, angles: Float64[np.ndarray, " copy"]
    ) -> Float64[np.ndarray, " copy"]:
        """Return the score of a first action and the reference's further ones, at given angles."""
        copies, used = self._copies, len(action)
        copies.restore(state.rows(np.arange(copies.size) % used))
        running = np.arange(copies.size) < used
        chosen = np.resize(action, copies.size)
        radians = np.deg2rad(np.resize(angles, copies.size))
        total = np.zeros(copies.size)
        while running.any():
            made = copies.step(chosen, auto_reset=False, rows=running)
            scored = np.cos(radians) * made.rewards.env + np.sin(radians) * made.rewards.social
            total[running] += scored[running]
            running &= made.ending == int(Ending.NONE)
            rows = np.flatnonzero(running)
            if len(rows):
                seen = copies.seen_by(self._reference)[rows]
                values = self._reference.q_values_at(seen, np.resize(angles, copies.size)[rows])
                chosen[rows] = values.argmax(axis=1)
        return total[:used]
