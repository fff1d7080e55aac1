"""Behaviour cloning of continuous actions: the maximum-likelihood squashed Gaussian.

Of all demonstrations alike, or weighted by how well they score at an angle, as
`learners.behaviour_cloning` does it for discrete actions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners import behaviour_cloning
from socialiq.learners.kernel import Terms
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.actor import Actor, log_density
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.types import Transitions


class BehaviourCloning(behaviour_cloning.BehaviourCloning):
    """Maximum likelihood of the demonstrated actions, which `EDGE` keeps from the bounds."""

    name: ClassVar[str] = "gaussian_behaviour_cloning"

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> BehaviourCloning:
        """Make the learner of sets of demonstrations.

        Raises:
            UserError: If there is none, they differ, or their actions are discrete.
        """
        table = behaviour_cloning.table_of(static, datasets, continuous=True)
        sizes = (int(datasets[0].observation.shape[1]), int(datasets[0].action.shape[1]))
        return cls(static, sizes, table)

    def network(self, key: PRNGKeyArray) -> Actor:
        """Draw an actor."""
        static, (n_features, size) = self.static, self.sizes
        shape = (n_features, static.hidden, size, static.activation, static.input_scale)
        return Actor.initialise(key, *shape, view=static.view)

    def loss(
        self,
        network: Any,
        target_network: Any,  # noqa: ARG002
        batch: Any,
        hyperparameters: HyperparameterArrays,  # noqa: ARG002
    ) -> tuple[Float[Array, ""], Terms]:
        """-E[log π(a|s)]."""
        mean, log_std = jax.vmap(network)(batch.observation)
        loss = -jnp.mean(jax.vmap(log_density)(batch.action, mean, log_std))
        return loss, {"loss": loss}

    def policy(
        self,
        hyperparameters: Any,
        state: TrainState,
        kept: Any = None,  # noqa: ARG002
    ) -> ActorPolicy:
        """Return the clone of one run."""
        return ActorPolicy.of(state.network, self.record(hyperparameters))
