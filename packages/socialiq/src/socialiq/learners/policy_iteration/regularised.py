"""Policy iteration that stays near a dial of demonstrated behaviour, for what no reward describes.

Demonstrators may be skilled in a way that the reward pair lacks: demonstrator i is best for
R(α_i) + h with an unknown h. By the performance difference lemma (Kakade and Langford 2002) every
policy π has

    J_{α_i + h}(π) = J_{α_i + h}(π_i) + E_π[Σ_t A_i(s_t, a_t)]

with A_i <= 0 the advantage of the demonstrator, 0 at its own action. So h is not needed where A_i
is known. That it is τ log π_i, of a soft demonstrator, is the idea of residual Q-learning (Li et
al. 2023, which learns another reward on top of a policy and needs no reward of the first).
Here the score of an angle is

    R(α) + η Σ_t log(β(a_t | s_t, α) / max_b β(b | s_t, α))

with β the clone (`learners.clone_dial`). The second part is 0 for the most likely action; a greedy
demonstrator has no τ, so η is a choice, in units of reward for a nat. R(α) stays in it as a whole,
not as R(α) - R(α_i), which is 0 at a demonstrator's angle: a clone's errors would stay there.
"""

from __future__ import annotations

from typing import Any, ClassVar

import jax
import numpy as np
from jaxtyping import Array, PRNGKeyArray
from scipy.special import softmax

from socialiq.learners.kernel import Terms
from socialiq.learners.policy_iteration.dial import (
    DialIteration,
    direction_of,
    of_rows,
    values_of,
)
from socialiq.learners.policy_iteration.train import expected_return
from socialiq.learners.state import HyperparameterArrays
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import score
from socialiq.types import RewardPair

ARBITRARY = 0.01
"""Share of demonstrated actions that are taken as arbitrary, so that no action is ruled out."""


class RegularisedIteration(DialIteration):
    """Policy iteration of a dial of logits, which begins with a clone."""

    name: ClassVar[str] = "regularised-dial-iteration"

    def network(self, key: PRNGKeyArray) -> DialNetwork:
        """Draw a network of logits."""
        one, (n_features, n_actions) = self.static, self.sizes
        shape = (n_features, one.hidden, n_actions, one.activation, one.view)
        return DialNetwork.initialise(key, *shape)

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Array, Terms]:
        """Less the expected score of softmax(output/τ)."""
        del target_network
        states, one = batch.states, hyperparameters
        direction = direction_of(states.observation)
        outputs = jax.vmap(network)(states.observation[:, :-1], direction)
        returns = score(of_rows(direction), states.returns)
        gain, entropy = expected_return(outputs, returns, one.temperature)
        gain, entropy = gain.mean(), entropy.mean()
        loss = -gain - one.entropy * entropy
        return loss, {"loss": loss, "gain": gain, "entropy": entropy}


class Likeness:
    """Worth of actions for being those of a clone, as reward pairs along (cos α, sin α).

    Args:
        clone: Dial whose values are log-probabilities.
        price: η, in units of reward for a nat.
        arbitrary: Share of actions that are taken as arbitrary.
    """

    def __init__(self, clone: DialPolicy, price: float, arbitrary: float = ARBITRARY) -> None:
        self._values, self._price, self._arbitrary = values_of(clone), price, arbitrary

    def __call__(self, observation: np.ndarray) -> RewardPair:
        """Return the pairs of each action, of observations that end with their angle."""
        likely = softmax(self._values(observation).astype(np.float64), axis=1)
        likely = (1.0 - self._arbitrary) * likely + self._arbitrary / likely.shape[1]
        worth = self._price * np.log(likely / likely.max(axis=1, keepdims=True))
        direction = of_rows(direction_of(observation))
        return RewardPair(direction.env * worth, direction.social * worth)
