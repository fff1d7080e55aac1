"""Terms of the IQ-Learn objective, one function per equation: divergences, terms, social priors.

Thesis 2.2.2, 4.3.1 and appendix B. In a prior, `target` is R(α) of the chosen pair of returns,
shape (batch,), and `strength` is λ.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.state import HyperparameterArrays
from socialiq.social.angle import score
from socialiq.types import Ending


class Divergence(NamedTuple):
    """φ and φ' above a floor, where the tangent takes over; None if φ is defined everywhere."""

    phi: Callable[[Any], Any]
    slope: Callable[[Any], Any]
    floor: float | None


Scalar = Float[Array, ""]
Column = Float[Array, " batch"]

DIVERGENCES: dict[str, Divergence] = {
    # χ²: the linear part; its quadratic part is term 3 of Eq 2.7.
    "chi2": Divergence(lambda x: x, jnp.ones_like, None),
    "kl": Divergence(lambda x: -jnp.exp(-x - 1), lambda x: jnp.exp(-x - 1), -10.0),
    "reverse_kl": Divergence(lambda x: 1 + jnp.log(x), lambda x: 1 / x, 0.1),
    "hellinger": Divergence(lambda x: x / (1 + x), lambda x: 1 / (1 + x) ** 2, -0.9),
    "js": Divergence(lambda x: jnp.log(2 - jnp.exp(-x)), lambda x: 1 / (2 * jnp.exp(x) - 1), -0.6),
}


def phi(name: str | Divergence, reward: Any) -> Any:
    """Return φ(r̂), continued by its tangent below the floor.

    Args:
        name: Name in `DIVERGENCES`, or a divergence.
        reward: r̂, of any shape.

    Returns:
        φ of each reward.
    """
    divergence = DIVERGENCES[name] if isinstance(name, str) else name
    if divergence.floor is None:
        return divergence.phi(reward)
    inside = jnp.maximum(reward, divergence.floor)
    return divergence.phi(inside) + divergence.slope(inside) * (reward - inside)


def phi_slope(name: str | Divergence, reward: Any) -> Any:
    """Return φ'(r̂): the weight of an expert transition in term 1 of Eq 2.7.

    Args:
        name: Name in `DIVERGENCES`, or a divergence.
        reward: r̂, of any shape.

    Returns:
        φ' of each reward, the slope of the tangent below the floor.
    """
    divergence = DIVERGENCES[name] if isinstance(name, str) else name
    if divergence.floor is None:
        return divergence.slope(reward)
    return divergence.slope(jnp.maximum(reward, divergence.floor))


def soft_value(
    q: Float[Array, "*batch action"], temperature: Scalar | float
) -> Float[Array, "*batch"]:
    """Return V(s) = τ log sum_a exp(Q(s, a) / τ) (Eq 2.5).

    Args:
        q: Q of each state and action, actions on the last axis.
        temperature: τ, in units of reward.

    Returns:
        V of each state.
    """
    return temperature * jax.nn.logsumexp(q / temperature, axis=-1)


def absorbing_value(n_actions: int, temperature: Scalar | float, discount: Scalar | float) -> Any:
    """Return the value of a state that is never left and pays nothing: the entropy bonus for ever.

    τ log|A| / (1 - γ). With V = 0 instead, ending an episode forfeits that bonus, which favours
    long episodes.

    Args:
        n_actions: `|A|`, the number of actions; of continuous ones the volume.
        temperature: τ, in units of reward.
        discount: γ.

    Returns:
        The value, in units of reward.
    """
    return temperature * jnp.log(n_actions) / (1.0 - discount)


def reward_bound(chi2_alpha: Scalar | float) -> Any:
    """4 α_χ, the greatest size of r̂ at the optimum if term 3 is over the mixture.

    Term 2 equals the learner's discounted return with entropy (IQ-Learn Cor. 2.1), so that with
    the occupancies d_E of the demonstrations and d of the learner the derivative in r̂(s, a) is
    -d_E + d + (d_E + d) r̂ / (4 α_χ). Its zero is 4 α_χ (d_E - d) / (d_E + d) (Al-Hafez et al.
    2023, in our constants).
    """
    return 4.0 * chi2_alpha


def regression_term(reward: Column, target: Any, chi2_alpha: Scalar | float) -> Scalar:
    """Return E[(r̂ - target)²] / (8 α_χ): one side of Eq 2.7 as a regression.

    The soft Bellman reward r̂ is regressed to a constant. Where term 2 is over the learner's own
    rows and these are drawn from its policy, E[V - γ V'] equals E[r̂] up to the entropy, which has
    no gradient in Q. With term 3 over as many rows of either side, terms 1 to 3 are then, up to a
    constant, E_E[(r̂ - 4 α_χ)²] / (8 α_χ) plus E_own[(r̂ + 4 α_χ)²] / (8 α_χ) (Al-Hafez et al.
    2023).

    Args:
        reward: r̂ of each row of one side.
        target: `reward_bound` for demonstrations, and its negative for own rows.
        chi2_alpha: α_χ.

    Returns:
        The term.
    """
    return jnp.mean(jnp.square(reward - target)) / (8.0 * chi2_alpha)


def value_bounds(
    n_actions: int,
    temperature: Scalar | float,
    discount: Scalar | float,
    chi2_alpha: Scalar | float,
) -> tuple[Any, Any]:
    """Return the least and greatest V(s), entropy included, under rewards within `reward_bound`.

    Args:
        n_actions: Number of actions; of continuous ones the volume.
        temperature: τ, in units of reward.
        discount: γ.
        chi2_alpha: α_χ.

    Returns:
        The least value, and the greatest one.
    """
    bound = reward_bound(chi2_alpha) / (1.0 - discount)
    return -bound, bound + absorbing_value(n_actions, temperature, discount)


def occupancy_value(
    expert_share: Float[Array, " kind"],
    own_share: Float[Array, " kind"],
    discount: Scalar | float,
    chi2_alpha: Scalar | float,
) -> Float[Array, " kind"]:
    """Return 4 α_χ (d_E - d) / (d_E + d) / (1 - γ), the optimal value of a state never left.

    Such a state has one transition, into itself, and its reward is the optimum of `reward_bound`.
    Both densities are proportional to how often the state is reached.

    Args:
        expert_share: Share of the demonstrations that end in each kind of ending.
        own_share: Share of the learner's own transitions that end in each kind.
        discount: γ.
        chi2_alpha: α_χ.

    Returns:
        The value after each kind of ending. It is 0, and not used, where neither side reaches the
        kind.
    """
    total = expert_share + own_share
    contrast = (expert_share - own_share) / jnp.where(total > 0.0, total, 1.0)
    return reward_bound(chi2_alpha) * contrast / (1.0 - discount)


def continuation(
    next_value: Column,
    ending: Int[Array, " batch"],
    treatment: dict[Ending, str],
    absorbing: Any,
    occupancy: Float[Array, " kind"] | None = None,
) -> Column:
    """Return (1 - d) V(s') of Eq 2.6, with d decided for each kind of ending.

    Where the episode goes on d is 0.

    Args:
        next_value: V(s') of each row.
        ending: Value of `types.Ending` of each row.
        treatment: Treatment of each kind: "zero" (d = 1), "bootstrap" (d = 0: the episode was only
            cut off), "absorbing" (d = 1 with the value `absorbing`) or "occupancy" (d = 1 with the
            value of its kind in `occupancy`).
        absorbing: `absorbing_value`.
        occupancy: `occupancy_value` of each kind; None if no treatment is "occupancy".

    Returns:
        The value that follows each row.
    """
    value = next_value
    for kind, choice in treatment.items():
        if choice == "bootstrap":
            continue
        replacement = absorbing if choice == "absorbing" else 0.0
        if choice == "occupancy":
            assert occupancy is not None
            replacement = occupancy[int(kind)]
        value = jnp.where(ending == int(kind), replacement, value)
    return value


def continued(
    next_value: Column,
    ending: Int[Array, " batch"],
    n_actions: int,
    temperature: Scalar | float,
    hyperparameters: HyperparameterArrays,
    static: Any,
    shares: Float[Array, "2 kind"] | None = None,
) -> Column:
    """Return (1 - d) V(s') by the endings of a config, with V(s') in bounds if it asks for them.

    Args:
        next_value: V(s') of each row.
        ending: Value of `types.Ending` of each row.
        n_actions: Number of actions; of continuous ones the volume.
        temperature: τ, in units of reward.
        hyperparameters: Numbers of one run.
        static: Config with `endings`, and `bounded` if it has that.
        shares: Shares of demonstrations and of own rows that end in each kind of ending; needed by
            the treatment "occupancy".

    Returns:
        The value that follows each row.
    """
    discount = hyperparameters.discount
    if getattr(static, "bounded", False):
        alpha = hyperparameters.chi2_alpha
        bounds = value_bounds(n_actions, temperature, discount, alpha)
        next_value = jnp.clip(next_value, *bounds)
    occupancy = None
    if shares is not None:
        occupancy = occupancy_value(shares[0], shares[1], discount, hyperparameters.chi2_alpha)
    absorbing = absorbing_value(n_actions, temperature, discount)
    return continuation(next_value, ending, static.endings.by_kind(), absorbing, occupancy)


def implicit_reward(
    q_taken: Column,
    continuation: Column,
    discount: Scalar | float,
) -> Column:
    """Return r̂(s, a) = Q(s, a) - γ (1 - d) V(s') (Eq 2.6).

    Args:
        q_taken: Q of the action taken, of each row.
        continuation: (1 - d) V(s') of each row.
        discount: γ.

    Returns:
        r̂ of each row.
    """
    return q_taken - discount * continuation


def expert_term(divergence: str | Divergence, expert_reward: Column) -> Scalar:
    """Return -E_E[φ'(r̂) r̂], term 1 of Eq 2.7.

    φ' is a constant weight here, so the gradient is that of -E_E[φ(r̂)], the objective of the
    IQ-Learn paper (its Eq 9).

    Args:
        divergence: Name in `DIVERGENCES`, or a divergence.
        expert_reward: r̂ of each demonstration.

    Returns:
        The term.
    """
    weight = jax.lax.stop_gradient(phi_slope(divergence, expert_reward))
    return -jnp.mean(weight * expert_reward)


def value_term(
    value: Column,
    continuation: Column,
    discount: Scalar | float,
) -> Scalar:
    """Return E[V(s) - γ (1 - d) V(s')], term 2 of Eq 2.7, over the batch that is passed.

    Args:
        value: V(s) of each row.
        continuation: (1 - d) V(s') of each row.
        discount: γ.

    Returns:
        The term.
    """
    return jnp.mean(value - discount * continuation)


def initial_value_term(initial_value: Column, discount: Scalar | float) -> Scalar:
    """Return (1 - γ) E_p0[V(s_0)], to which term 2 is equal (IQ-Learn Cor. 2.1).

    Args:
        initial_value: V(s_0) of each true initial state.
        discount: γ.

    Returns:
        The term.
    """
    return (1.0 - discount) * jnp.mean(initial_value)


def chi2_term(reward: Column, chi2_alpha: Scalar | float) -> Scalar:
    """Return E[r̂²] / (4 α_χ), term 3 of Eq 2.7.

    Args:
        reward: r̂ of each row.
        chi2_alpha: α_χ.

    Returns:
        The term.
    """
    return jnp.mean(jnp.square(reward)) / (4.0 * chi2_alpha)


def social_prior(
    reward: Column, target: Column, strength: Scalar | float, trimmed: float = 0.0
) -> Scalar:
    """Return L_reg = E_E[(r̂ - λ R(α))²] (Eq 4.4).

    Args:
        reward: r̂ of each row.
        target: R(α) of each row.
        strength: λ.
        trimmed: Share of the rows with the largest squares that is left out.

    Returns:
        The mean square of the rows that are kept.
    """
    squares = jnp.square(reward - strength * target)
    if trimmed > 0.0:  # least trimmed squares (Rousseeuw 1984): labels that fit nothing don't count
        squares = jnp.sort(squares)[: squares.size - int(trimmed * squares.size)]
    return jnp.mean(squares)


def bellman_shift(reward: Column, target: Column, strength: Scalar | float) -> Column:
    """Return r̂_shifted = r̂ - λ R(α) (Eq B.1).

    In term 1 with χ² (φ' = 1) the shift adds a constant to the loss, so it has no gradient: it
    steers only under another divergence or inside term 3, where it is `shifted_chi2`.

    Args:
        reward: r̂ of each row.
        target: R(α) of each row.
        strength: λ.

    Returns:
        The shifted reward of each row.
    """
    return reward - strength * target


def shifted_chi2(
    reward: Column,
    target: Column,
    strength: Scalar | float,
    chi2_alpha: Scalar | float,
    prior: Callable[..., Scalar] = social_prior,
) -> Scalar:
    """Return E[(r̂ - λ R(α))²] / (4 α_χ): term 3 itself centred on the social score.

    One quadratic instead of Eq 4.5's two, whose sum is itself such a quadratic: with
    c = 1/(4 α_χ), c r̂² + w (r̂ - λR)² = (c + w) (r̂ - λR w/(c + w))² + constant.

    Args:
        reward: r̂ of each row.
        target: R(α) of each row.
        strength: λ.
        chi2_alpha: α_χ.
        prior: Function of reward, target and strength that gives the mean square.

    Returns:
        The term.
    """
    return prior(reward, target, strength) / (4.0 * chi2_alpha)


def demonstration_weights(
    target: Float[Array, " transition"],
    allowed: Bool[Array, " transition"],
    reweight_temperature: Scalar | float,
) -> Float[Array, " transition"]:
    """Return w_i = exp(R_i / τ_w) / sum_j exp(R_j / τ_w) (Eq B.2), over the allowed transitions.

    Args:
        target: R(α) of each transition.
        allowed: Whether each transition may have a weight.
        reweight_temperature: τ_w, in units of the target.

    Returns:
        The weights, of sum 1; 0 for transitions that are not allowed.
    """
    logits = jnp.where(allowed, target / reweight_temperature, -jnp.inf)
    exponentials = jnp.exp(logits - jnp.max(logits))
    return exponentials / jnp.sum(exponentials)


def table_weights(
    table: ExpertTable, hyperparameters: HyperparameterArrays
) -> Float[Array, " transition"]:
    """Return the weights of Eq B.2 over the transitions of a run's data set, by their targets.

    Args:
        table: Demonstrations of all runs.
        hyperparameters: Numbers of one run: its set, its angle's weights, and τ_w.

    Returns:
        The weights of all rows of the table; 0 outside the run's set.
    """
    rows = jnp.arange(table.columns.action.shape[0])
    dataset = hyperparameters.dataset
    first = table.row_bounds[dataset]
    end = table.row_bounds[dataset + 1]
    target = score(hyperparameters.weights, table.columns.target)
    allowed = (rows >= first) & (rows < end)
    return demonstration_weights(target, allowed, hyperparameters.reweight_temperature)


def effective_sample_size(weights: Float[Array, " transition"]) -> Scalar:
    """1 / sum_i w_i²: how many equally weighted transitions the weights are worth."""
    return 1.0 / jnp.sum(jnp.square(weights))
