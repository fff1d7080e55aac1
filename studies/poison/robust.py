"""Learners of the field for demonstrations of mixed quality, and medians of means.

Written from the papers' models, without their code; what differs is ours, and said here.

CIQL (arXiv 2312.11194, 2023): IQ-Learn whose expert occupancy weighs each transition by a
confidence β in [0, 1], E_E[β f] / E_E[β]: the variant that filters noise, not the one that
penalises it. Their β is the angle of a robot's motion to its goal; ours is the rank of the
episode's R(α) in the set, so it reads labels.

RIL-Co (Tangkaratt et al. 2021, arXiv 2010.10181): a classifier g of demonstrations (+) and the
learner's own rows (-) with a symmetric loss, ℓ(z) + ℓ(-z) = 1. Two classifiers learn from one half
of the demonstrations each. A share 1 - λ of a classifier's negative side is demonstrations of the
opposite half, those that the opposite classifier scores lowest. The learner maximises the risk that
g minimises: by trust regions in the paper, by soft Q-learning on ℓ(-g) - 1/2 here, whose constant
keeps long episodes from paying.

ILEED (Beliaev et al. 2022, arXiv 2202.01288): demonstrator i acts by ρ_i(s) π(a|s) + (1 - ρ_i(s)) /
|A| with ρ_i(s) = σ(<f(s), ω_i>); π, f and ω maximise the likelihood. The driver's name is itself a
claim, so here every episode counts as a separate demonstrator.
"""

from collections.abc import Sequence
from typing import Any, ClassVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from socialiq import QPolicy, score
from socialiq.learners.behaviour_cloning import BehaviourCloning
from socialiq.learners.expert_table import Batch, draw_between
from socialiq.learners.iq_learn.objective import UserFunctions
from socialiq.learners.iq_learn.train import IQLearn
from socialiq.nn.q_network import QNetwork
from socialiq.types import Transitions
from socialiq_lab.baselines import ActingByValues, ValuesLearner, of_taken, summed

Rows = Float[Array, " batch"]
BLOCKS = 16  # of a batch, for medians of means
EMBEDDED = 8  # length of ILEED's f(s) and ω
LAMBDA = 0.5  # share of the learner's own rows on RIL-Co's negative side
PSEUDO = 4  # one demonstration of a batch in so many is a pseudo-labelled negative of RIL-Co


def median_of_means(reward: Rows, target: Rows, strength: Any) -> Float[Array, ""]:
    """L_reg (Eq 4.4) as the median of its means over blocks (Lerasle & Oliveira 2011).

    Args:
        reward: r̂ of each row of a batch.
        target: R(α) of each row.
        strength: λ.
    """
    squares = jnp.square(reward - strength * target)
    return jnp.median(jnp.mean(squares.reshape(min(BLOCKS, squares.size), -1), axis=1))


class MediansOfMeans(IQLearn):
    """IQ-Learn whose social prior is a median of means."""

    own: UserFunctions = eqx.field(static=True, default=UserFunctions(prior=median_of_means))


def confidences(scores: Rows, inside: Bool[Array, " batch"]) -> Rows:
    """Return the share of a set's rows that score no better.

    Args:
        scores: Score of each row of the table.
        inside: Whether each row belongs to the set.

    Returns:
        Confidence of each row, 0 outside the set.
    """
    ordered = jnp.sort(jnp.where(inside, scores, jnp.inf))
    ranks = jnp.searchsorted(ordered, scores, side="right")
    return jnp.where(inside, ranks / jnp.sum(inside), 0.0)


class ConfidenceWeighted(IQLearn):
    """CIQL: demonstrations are drawn by their confidence."""

    name: ClassVar[str] = "ciql"
    target_kind: ClassVar[str] = "trajectory"

    def initialise(self, hyperparameters: Any) -> tuple[Any, Any]:
        """Draw a network, and weigh the rows of the run's set."""
        state, carry = super().initialise(hyperparameters)
        table: Any = self.table
        bounds = table.row_bounds
        numbers = jnp.arange(len(table.columns.action))
        number = hyperparameters.dataset
        inside = (numbers >= bounds[number]) & (numbers < bounds[number + 1])
        weights = confidences(score(hyperparameters.weights, table.columns.target), inside)
        return state, carry._replace(cumulative=jnp.cumsum(weights / jnp.sum(weights)))


def symmetric_loss(margin: Array) -> Array:
    """ℓ(z): the mean of the normalised logistic loss and the sigmoid loss (RIL-Co's AP loss)."""
    right = jax.nn.softplus(-margin)
    wrong = jax.nn.softplus(margin)
    return (right / (right + wrong) + jax.nn.sigmoid(-margin)) / 2


def risk(positive: Array, replayed: Array, pseudo: Array) -> Float[Array, ""]:
    """Half of E[ℓ(g)] of demonstrations and of E[ℓ(-g)] of the negative side's mixture.

    Args:
        positive: g of demonstrations.
        replayed: g of the learner's own rows.
        pseudo: g of demonstrations that are labelled as negative.
    """
    negative = LAMBDA * jnp.mean(symmetric_loss(-replayed))
    negative += (1.0 - LAMBDA) * jnp.mean(symmetric_loss(-pseudo))
    return (jnp.mean(symmetric_loss(positive)) + negative) / 2


class CoNetworks(ActingByValues):
    """Q(s, ·), which acts, and the two classifiers g(s, ·)."""

    classifiers: tuple[QNetwork, QNetwork]


class CoPseudoLabelling(ValuesLearner):
    """RIL-Co: soft Q-learning against two classifiers that label for each other."""

    name: ClassVar[str] = "ril_co"

    def network(self, key: Any) -> CoNetworks:
        """Draw the networks."""
        values, *classifiers = (
            super(CoPseudoLabelling, self).network(jax.random.fold_in(key, number))
            for number in range(3)
        )
        return CoNetworks(values, tuple(classifiers))

    def draw(self, hyperparameters: Any, state: Any, carry: Any) -> tuple[Any, Any]:
        """Return own transitions, and demonstrations of even and of odd rows; act before.

        Args:
            hyperparameters: Numbers of the run.
            state: State of the run, whose network acts.
            carry: Random key, replay and episode.

        Returns:
            Own rows with the pair of halves, and the next carry.
        """
        batches, carry = super().draw(hyperparameters, state, carry)
        table: Any = self.table
        key, for_rows = jax.random.split(carry.key)
        first, end = (table.row_bounds[hyperparameters.dataset + side] for side in (0, 1))
        size = self.static.batch_size
        pairs = draw_between(for_rows, 2 * size, 0, (end - first) // 2).reshape(2, size)
        halves = tuple(table.rows(first + 2 * pairs[half] + half) for half in (0, 1))
        return (batches.replay, halves), carry._replace(key=key)

    def loss(self, network: Any, target_network: Any, batch: Any, hyperparameters: Any):
        """Both classifiers' risks, and half the squared Bellman error of Q on ℓ(-g) - 1/2.

        Args:
            network: Q and the two classifiers.
            target_network: Slow copy of the network, whose Q gives the value of the next
                observation.
            batch: Own rows, and demonstrations in two halves.
            hyperparameters: Numbers of the run.

        Returns:
            The sum, and the terms "first", "second", "bellman" and "loss".
        """
        first, second = network.classifiers
        run = hyperparameters
        own, halves = batch
        terms = {}
        for name, learns, labels, (half, other) in (
            ("first", first, second, halves),
            ("second", second, first, halves[::-1]),
        ):
            doubt = jax.lax.stop_gradient(_of_taken(labels, other))
            worst = jnp.argsort(doubt)[: len(doubt) // PSEUDO]
            pseudo = _of_taken(learns, other)[worst]
            terms[name] = risk(_of_taken(learns, half), _of_taken(learns, own), pseudo)
        reward = run.strength * (symmetric_loss(-_of_taken(first, own)) - 0.5)
        terms["bellman"] = self.bellman_error(network, target_network, own, reward, run)
        return summed(terms)


def _of_taken(network: Any, rows: Batch) -> Rows:
    return of_taken(jax.vmap(network)(rows.observation), rows.action)


class Experts(eqx.Module):
    """π(·|s) as logits, f(s), and ω of each demonstrator."""

    policy: QNetwork
    embedding: QNetwork
    skill: Float[Array, "demonstrator size"]


def expertise(network: Experts, observation: Array, demonstrator: Array) -> Rows:
    """Return ρ_i(s) = σ(<f(s), ω_i>) of each row.

    Args:
        network: π, f and ω.
        observation: Observation s of each row.
        demonstrator: Number i of each row's demonstrator.
    """
    products = jax.vmap(network.embedding)(observation) * network.skill[demonstrator]
    return jax.nn.sigmoid(jnp.sum(products, axis=1))


class ExpertiseEstimating(BehaviourCloning):
    """ILEED, from demonstrations alone; `demonstrators` is the episode of each row in its set."""

    demonstrators: Any = None
    most: int = eqx.field(static=True, default=0)  # episodes of a set
    name: ClassVar[str] = "ileed"

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> "ExpertiseEstimating":
        """Make the learner of sets of demonstrations, and number each set's episodes.

        Args:
            static: Static configuration of all runs.
            datasets: Sets of demonstrations.
        """
        plain: Any = super().of(static, datasets)
        numbers = np.concatenate([cast(Any, data).episode for data in datasets])
        most = int(numbers.max()) + 1
        return cls(static, plain.sizes, plain.table, jnp.asarray(numbers), most)

    def network(self, key: Any) -> Experts:
        """Draw π and f; every ω begins at 0, expertise 1/2."""
        static = self.static
        n_features, _ = self.sizes
        shape = (n_features, static.hidden, EMBEDDED, static.activation, static.view)
        embedding = QNetwork.initialise(jax.random.fold_in(key, 1), *shape)
        return Experts(super().network(key), embedding, jnp.zeros((self.most, EMBEDDED)))

    def draw(self, hyperparameters: Any, state: Any, carry: Any) -> tuple[Any, Any]:  # noqa: ARG002
        """Return rows of the run's set with their demonstrators, and the next carry.

        Args:
            hyperparameters: Numbers of the run.
            state: Not used.
            carry: Random key.
        """
        table: Any = self.table
        key, for_rows = jax.random.split(carry.key)
        bounds = (table.row_bounds[hyperparameters.dataset + side] for side in (0, 1))
        rows = draw_between(for_rows, self.static.batch_size, *bounds)
        return (table.rows(rows), self.demonstrators[rows]), carry._replace(key=key)

    def loss(self, network: Any, _target: Any, batch: Any, _numbers: Any):
        """Negative log-likelihood of the actions under each demonstrator's mixture.

        Args:
            network: π, f and ω.
            batch: Rows, and the demonstrator of each row.

        Returns:
            The mean over the batch, and the same as the term "loss".
        """
        rows, demonstrator = batch
        logits = jax.vmap(network.policy)(rows.observation)
        chances = jax.nn.softmax(logits)[jnp.arange(len(logits)), rows.action]
        skill = expertise(network, rows.observation, demonstrator)
        loss = -jnp.mean(jnp.log(skill * chances + (1.0 - skill) / logits.shape[1]))
        return loss, {"loss": loss}

    def policy(self, hyperparameters: Any, state: Any, _retained: Any = None) -> QPolicy:
        """Return the policy that the best demonstrator would have.

        Args:
            hyperparameters: Numbers of the run.
            state: State of the run, with the trained networks.
        """
        return QPolicy.of(state.network.policy, 1.0, self.record(hyperparameters))
