"""Learners that act in the world: LS-IQ, T-REX, and the inferred rewards of ParIRL.

LS-IQ (Al-Hafez et al. 2023): with the penalty c/2 (E_E[r̂²] + E_π[r̂²]) IQ-Learn's objective is, up
to a constant, c/2 E_E[(r̂ - 1/c)²] + c/2 E_π[(r̂ + 1/c)²], so demonstrated transitions have the
reward 1/c and the learner's own -1/c. LS-IQ gives Q of a demonstrated action its largest value
1/(c (1 - γ)) as a fixed target, bounds the values that follow, and lets an episode's end be a state
for ever, whose reward is the mean over the transitions that end an episode.

T-REX (Brown et al. 2019): the reward r(s, a) explains the ranks by R(α) of pairs of episodes; soft
Q-learning on it acts in the world meanwhile. The paper has two stages and a reward of observations
alone: in these worlds a state doesn't show what was done.

ParIRL (Kim et al. 2024): a reward is inferred for the egoists and one for the altruists. A policy
in between is one of their mean, weighted by its preference. One network conditioned on the
preference learns all of them by acting; the paper distils the front into a diffusion model.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from socialiq import Ending, RewardPair, score
from socialiq.learners import collect, expert_table, settings
from socialiq.learners.iq_learn import config, losses
from socialiq.learners.iq_learn.train import IQLearn
from socialiq.nn.q_network import QNetwork
from socialiq.types import Act, Transitions
from socialiq_lab import baselines as shared


@dataclass(frozen=True)
class LSIQConfig(config.IQLearnConfig):
    """Choices that shape the program; those of acting are IQ-Learn's."""

    fixed_target: bool = True
    """Whether Q of demonstrated actions has a fixed target, or r̂ has the target 1/c."""


@dataclass(frozen=True)
class LSIQHyperparameters(config.IQLearnHyperparameters):
    """Numbers of one run, all traced."""

    regularisation: settings.Positive = 0.5  # c: rewards lie between -1/c and 1/c


class LSIQ(IQLearn):
    """Least-squares inverse Q-learning; acts with softmax(Q/τ)."""

    StaticConfig: ClassVar[type] = LSIQConfig
    Hyperparameters: ClassVar[type] = LSIQHyperparameters
    name: ClassVar[str] = "ls_iq"

    def loss(self, network: Any, target_network: Any, batch: Any, hyperparameters: Any):
        """Half the squared distances of demonstrations and of own transitions to their targets.

        Args:
            network: Q.
            target_network: Slow copy of Q, for the value of the next observation.
            batch: Demonstrated and own rows.
            hyperparameters: Numbers of the run.

        Returns:
            The sum, and the terms "expert", "own" and "loss".
        """
        largest = 1.0 / hyperparameters.regularisation
        discount = hyperparameters.discount
        bound = largest / (1.0 - discount)
        sides = (batch.expert.ending, batch.replay.ending)
        ends = [jnp.sum(ending != int(Ending.NONE)) for ending in sides]
        absorbing = largest * (ends[0] - ends[1]) / jnp.maximum(ends[0] + ends[1], 1)
        terms = {}
        for name, rows, reward in zip(
            ("expert", "own"), batch[:2], (largest, -largest), strict=True
        ):
            q_next = jax.vmap(target_network)(rows.next_observation)
            value = losses.soft_value(q_next, hyperparameters.temperature)
            ended = rows.ending != int(Ending.NONE)
            follows = jnp.where(ended, absorbing / (1.0 - discount), jnp.clip(value, -bound, bound))
            target = reward + discount * follows
            if name == "expert" and self.static.fixed_target:
                target = jnp.full_like(target, largest / (1.0 - discount))
            q = shared.of_taken(jax.vmap(network)(rows.observation), rows.action)
            terms[name] = jnp.mean(jnp.square(q - jax.lax.stop_gradient(target))) / 2
        return shared.summed(terms)


@dataclass(frozen=True)
class TREXConfig(config.IQLearnConfig):
    """Choices that shape the program; those of acting are IQ-Learn's."""

    pairs: settings.Count = 8  # pairs of episodes of an update


class TREXNetworks(shared.ActingByValues):
    """Q(s, ·), which acts, and the learned reward r(s, ·)."""

    reward: QNetwork


class TREXRows(NamedTuple):
    """The learner's own transitions, and pairs of demonstrated episodes."""

    replay: expert_table.Batch
    pairs: shared.Pairs


class TREX(shared.ValuesLearner):
    """Reward from ranks of pairs of `episodes`, and soft Q-learning on it."""

    episodes: Any = None
    StaticConfig: ClassVar[type] = TREXConfig
    name: ClassVar[str] = "trex"

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> "TREX":
        """Make the learner of sets of demonstrations and their episodes.

        Args:
            static: Static configuration of all runs.
            datasets: Sets of demonstrations.
        """
        learner: Any = super().of(static, datasets)
        episodes = shared.Episodes.of(datasets, learner.table)
        return cls(static, learner.sizes, learner.table, episodes=episodes)

    def network(self, key: Any) -> TREXNetworks:
        """Draw both networks."""
        return TREXNetworks(super().network(key), super().network(jax.random.fold_in(key, 1)))

    def draw(self, hyperparameters: Any, state: Any, carry: Any) -> tuple[Any, Any]:
        """Act, sample the replay, and draw pairs of episodes.

        Args:
            hyperparameters: Numbers of the run.
            state: State of the run, whose network acts.
            carry: Random key, replay and episode.

        Returns:
            Own rows with pairs of episodes (`TREXRows`), and the next carry.
        """
        batches, carry = super().draw(hyperparameters, state, carry)
        assert batches.replay is not None
        key, for_pairs = jax.random.split(carry.key)
        scores = score(hyperparameters.weights, self.episodes.totals)
        options = self.table, for_pairs, hyperparameters.dataset, self.static.pairs, scores
        return TREXRows(batches.replay, self.episodes.pairs(*options)), carry._replace(key=key)

    def loss(self, network: Any, target_network: Any, batch: Any, hyperparameters: Any):
        """Loss of the pairs' ranks, and half the squared Bellman error of Q on the learned reward.

        Args:
            network: Q and the learned reward.
            target_network: Slow copy of the network, whose Q gives the value of the next
                observation.
            batch: Own rows, and pairs of episodes.
            hyperparameters: Numbers of the run.

        Returns:
            The sum, and the terms "ranks", "bellman" and "loss".
        """
        rows = batch.replay
        run = hyperparameters
        reward = shared.of_taken(jax.vmap(network.reward)(rows.observation), rows.action)
        scaled = run.strength * reward
        return shared.summed(
            {
                "ranks": shared.preference_loss(network.reward, batch.pairs),
                "bellman": self.bellman_error(network, target_network, rows, scaled, run),
            }
        )


class Inferred(NamedTuple):
    """Reward that a trained IQ-Learn implies, by its Q, the temperature τ of V, and γ."""

    network: QNetwork
    temperature: float
    discount: float


@eqx.filter_jit
def inferred_reward(
    network: QNetwork, temperature: float, discount: float, batch: expert_table.Batch
) -> Float[Array, " batch"]:
    """Return r̂ = Q(s, a) - γ (1 - d) V(s') (Eq 2.6) of rows; d is 1 at every ending.

    Args:
        network: Trained Q.
        temperature: τ of V.
        discount: γ.
        batch: Rows of transitions.
    """
    value = losses.soft_value(jax.vmap(network)(batch.next_observation), temperature)
    follows = jnp.where(batch.ending == int(Ending.NONE), value, 0.0)
    return shared.of_taken(jax.vmap(network)(batch.observation), batch.action) - discount * follows


def inferring(source: collect.Source, rewards: Sequence[Inferred]) -> collect.Source:
    """Return a source outside JAX whose (r_env, r_social) are the two inferred rewards.

    Args:
        source: Source of the world's transitions.
        rewards: Inferred reward in the place of r_env, then that in the place of r_social.
    """

    def relabelled(act: Act, rng: Any) -> expert_table.Batch:
        batch = source(act, rng)
        pair = RewardPair(*(inferred_reward(*reward, batch) for reward in rewards))
        return batch._replace(target=pair)

    return relabelled
