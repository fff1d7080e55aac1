"""Continuous IQ-Learn (Garg et al. 2021, section 4.2 and algorithm 1) with the social prior.

For a fixed policy π with V(s) = E_π[Q(s, a) - τ log π(a|s)] and r̂ = Q(s, a) - γ (1 - d) V(s') the
critics minimise the objective of discrete actions, Eq 2.7 and 4.5 of the thesis, term by term;
the actor maximises E_π[Q - τ log π], which leads V to τ log ∫ exp(Q/τ) da, the continuous Eq 2.5.
Each of the two critics has the objective for itself; the value of the next state is the smaller.

As a dial each row has an angle drawn for it, which the networks read and the prior is centred at.
"""

from __future__ import annotations

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners.continuous import actor_critic
from socialiq.learners.continuous.actor_critic import ActorCritic, Carry, Networks, Rows
from socialiq.learners.continuous.config import ActorIQLearnConfig, ActorIQLearnHyperparameters
from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.objective import OURS, UserFunctions, terms_of
from socialiq.learners.iq_learn.train import demonstrated, followed, unread
from socialiq.learners.kernel import Terms
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.actor import TwinCritics, frozen
from socialiq.social.angle import score

Scalar = Float[Array, ""]


class ContinuousIQLearn(ActorCritic):
    """Social Impact Regularized IQ-Learn for continuous actions.

    Attributes:
        own: Functions of the user's own in the place of ours; not a loss.
    """

    own: UserFunctions = eqx.field(static=True, default=OURS)

    StaticConfig: ClassVar[type] = ActorIQLearnConfig
    Hyperparameters: ClassVar[type] = ActorIQLearnHyperparameters
    name: ClassVar[str] = "continuous_iq_learn"
    shown: ClassVar[bool] = True

    @property
    def keeps_replay(self) -> bool:
        """Whether the run is online."""
        return self.static.online

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, Carry]:
        """Draw networks, start an episode, and weigh the demonstrations."""
        state, carry = super().initialise(hyperparameters)
        return state, carry._replace(more=demonstrated(self, hyperparameters))

    def demonstrated(
        self, key: PRNGKeyArray, hyperparameters: HyperparameterArrays, carry: Carry
    ) -> Batch:
        """Return demonstrations, with the prior "reweighting" by their weights.

        Args:
            key: Random key.
            hyperparameters: Numbers of one run.
            carry: Carry of the run, with the cumulative weights.

        Returns:
            A batch of `batch_size` demonstrations.
        """
        cumulative, _ = carry.more
        if cumulative is None:
            return super().demonstrated(key, hyperparameters, carry)
        assert self.table is not None
        return self.table.sample_weighted(key, cumulative, self.static.batch_size)

    def draw(
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Carry
    ) -> tuple[Rows, Carry]:
        """Act, sample rows, first states if term 2 is over them, and count endings.

        Args:
            hyperparameters: Numbers of one run.
            state: State of the run, with the actor that acts.
            carry: Carry of the run.

        Returns:
            The rows, demonstrations first, and the next carry.
        """
        for_initial, key = jax.random.split(carry.key)
        rows, carry = super().draw(hyperparameters, state, carry._replace(key=key))
        cumulative, endings = carry.more
        assert self.table is not None
        if self.static.value_term == "v0":
            size = self.static.batch_size
            first = self.table.sample_initial(for_initial, hyperparameters.dataset, size)
            rows = rows._replace(initial=first)
        if endings is not None:
            endings = followed(endings, rows.batch.ending[rows.n_expert :], state)
            rows = rows._replace(more=endings)
            carry = carry._replace(more=(cumulative, endings))
        return rows, carry

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Return the mean of both critics' objectives, plus the losses of actor and temperature.

        Args:
            network: Actor, critics and log τ.
            target_network: Running average of these.
            batch: Rows of the update.
            hyperparameters: Numbers of one run.

        Returns:
            The loss, and its terms by name; "max_q", "expert_reward" and "entropy" are recorded
            only.
        """
        rows = batch
        for_critics, for_actor = jax.random.split(batch.key)
        of_each = self.critic_terms(network, target_network, rows, for_critics, hyperparameters)
        terms = jax.tree.map(lambda *values: sum(values) / len(values), *of_each)
        total = jnp.sum(jnp.stack([terms[name] for name in ADDED if name in terms]))
        inputs = self.inputs(rows.batch.observation, rows.direction)
        terms |= self.improvement(network, inputs, for_actor, hyperparameters)
        total = total + terms["actor"] + terms.get("tuning", 0.0)
        return total, terms | {"loss": total}

    def no_angle(self) -> str:
        """Return why no term of the objective reads an angle; "" if one does."""
        return unread(self.static, super().no_angle(), self.own)

    def critic_terms(
        self,
        network: Networks,
        target_network: Networks,
        rows: Rows,
        key: PRNGKeyArray,
        hyperparameters: HyperparameterArrays,
    ) -> list[Terms]:
        """Return the terms of Eq 2.7 and 4.5 for each critic.

        Args:
            network: Actor, critics and log τ.
            target_network: Running average of these.
            rows: Rows of the update.
            key: Random key of the drawn actions.
            hyperparameters: Numbers of one run.

        Returns:
            The terms of the first and of the second critic; "max_q" and "expert_reward" (mean r̂ on
            demonstrations) are recorded only.
        """
        batch = rows.batch
        chi2_alpha = hyperparameters.chi2_alpha
        target = score(rows.direction, batch.target)
        n_expert = rows.n_expert
        critics = (network, target_network.critics)
        value, after, start = self.values(*critics, rows, key, hyperparameters)
        taken = jax.vmap(network.critics)(
            self.inputs(batch.observation, rows.direction), batch.action
        )
        terms_by_critic = []
        for critic in range(2):
            follows = after[:, critic]
            reward = losses.implicit_reward(taken[:, critic], follows, hyperparameters.discount)
            if self.static.critic == "regression":
                terms = regression_terms(reward[:n_expert], reward[n_expert:], chi2_alpha)
            else:
                first = start if start is None else start[:, critic]
                columns = (reward, target, value[:, critic], follows, first)
                terms = terms_of(*columns, hyperparameters, self.static, self.own)
            terms["max_q"] = jnp.max(jnp.abs(taken))
            terms["expert_reward"] = jnp.mean(reward[:n_expert])
            terms_by_critic.append(terms)
        return terms_by_critic

    def values(
        self,
        network: Networks,
        target_critics: TwinCritics,
        rows: Rows,
        key: PRNGKeyArray,
        hyperparameters: HyperparameterArrays,
    ) -> tuple[Float[Array, "batch 2"], Float[Array, "batch 2"], Float[Array, "first 2"] | None]:
        """Return V(s), (1 - d) V(s') and V(s_0), of each critic.

        V(s') is the smaller of the target critics' without gradient, or with `next_value` online
        each critic's own with gradient.

        Args:
            network: Actor, critics and log τ.
            target_critics: Running average of the critics.
            rows: Rows of the update.
            key: Random key of the drawn actions.
            hyperparameters: Numbers of one run.

        Returns:
            The three values, each (row, critic); the last one is None if the rows have no initial
            states.
        """
        keys = jax.random.split(key, 3)
        temperature = self.temperature(network, hyperparameters)
        batch = rows.batch
        inputs = self.inputs(batch.observation, rows.direction)
        after = self.inputs(batch.next_observation, rows.direction)
        value = self.value_of(network, network.critics, inputs, keys[0], temperature)
        if self.static.next_value == "target":
            next_value = self.value_of(network, target_critics, after, keys[1], temperature, True)
        else:
            next_value = self.value_of(network, network.critics, after, keys[1], temperature)
        settings = (self.volume, temperature, hyperparameters, self.static, rows.more)
        follows = [
            losses.continued(next_value[:, critic], batch.ending, *settings) for critic in range(2)
        ]
        start = None
        if rows.initial is not None:
            count = len(rows.initial)
            direction = jax.tree.map(lambda column: column[:count], rows.direction)
            first = self.inputs(rows.initial, direction)
            start = self.value_of(network, network.critics, first, keys[2], temperature)
        return value, jnp.stack(follows, axis=1), start

    def value_of(
        self,
        network: Networks,
        critics: TwinCritics,
        inputs: Float[Array, "batch input"],
        key: PRNGKeyArray,
        temperature: Scalar,
        smaller: bool = False,
    ) -> Float[Array, "batch 2"]:
        """Return V(s) = E_π[Q_i - τ log π] of each critic; π is fixed.

        Args:
            network: The actor, which gets no gradient.
            critics: The critics.
            inputs: Inputs of each state, (batch, input).
            key: Random key of the drawn actions.
            temperature: τ, in units of reward.
            smaller: Whether the smaller Q of each drawn action is taken for both critics.

        Returns:
            V of each state by each critic.
        """
        count = self.static.actions_per_state
        sampled = actor_critic.draw_actions(frozen(network.actor), inputs, key, count)
        q = actor_critic.drawn_values(critics, inputs, sampled)
        if smaller:
            q = jnp.broadcast_to(q.min(axis=-1, keepdims=True), q.shape)
        columns = [
            actor_critic.soft_value(q[..., critic], sampled, temperature) for critic in range(2)
        ]
        return jnp.stack(columns, axis=1)


def regression_terms(
    expert: Float[Array, " expert"], learner: Float[Array, " own"], chi2_alpha: Scalar | float
) -> Terms:
    """Return the two terms of the regression of r̂ (`losses.regression_term`).

    Args:
        expert: r̂ of the demonstrations.
        learner: r̂ of the own rows.
        chi2_alpha: α_χ of Eq 2.7.

    Returns:
        The terms "expert" and "own".
    """
    bound = losses.reward_bound(chi2_alpha)
    return {
        "expert": losses.regression_term(expert, bound, chi2_alpha),
        "own": losses.regression_term(learner, -bound, chi2_alpha),
    }


ADDED = ("expert", "value", "chi2", "prior", "own")
"""Terms of a critic's objective."""
