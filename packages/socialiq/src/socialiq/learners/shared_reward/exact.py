"""Maximum-entropy fit of a reward correction f(s, a) in a known MDP of finite horizon, exactly.

Over groups i of demonstrations, each with a centre m_i (usually R(a_i)) and a weight p_i,

    max_f  Σ_i p_i { E_i[Σ_t m_i + f] - V_i(f) } - c E[Σ_t f²] - ε c Σ_{s,a} f²

V_i is the soft value of m_i + f at temperature τ (Eq 2.5) from the initial states. It is IQ-Learn's
objective with χ² (Garg et al. 2021, Eq 9) in terms of the reward, where it is concave, and with f
shared by the groups. ε draws f to 0 where nothing is demonstrated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from socialiq.errors import UserError
from socialiq.mdp.horizon import horizon_evaluation, soft_horizon_optimum
from socialiq.mdp.tabular import TabularMDP, check_reward


class Group(NamedTuple):
    """Demonstrations that are explained by one reward.

    Attributes:
        weight: p_i, its share of all demonstrators.
        visits: Expected number of times per episode that an action is taken in a state.
        centre: m_i, the part of the reward that is known.
    """

    weight: float
    visits: Float[np.ndarray, "state action"]
    centre: Float[np.ndarray, "state action"]


class Settings(NamedTuple):
    """Numbers of a fit.

    Attributes:
        horizon: Longest episode.
        temperature: τ of the demonstrators' softness.
        shrinkage: c, how strongly f is drawn to 0 where there are demonstrations.
        spread: ε, the same where there are none, relative to c and per pair.
        tolerance: Largest derivative at which L-BFGS stops.
        max_iterations: Of L-BFGS.
    """

    horizon: int
    temperature: float = 0.1
    shrinkage: float = 0.2
    spread: float = 1e-3
    tolerance: float = 1e-6
    max_iterations: int = 1000


class Fit(NamedTuple):
    """The maximiser.

    Attributes:
        correction: f.
        iterations: Of L-BFGS.
        slope: Largest absolute derivative left.
    """

    correction: Float[np.ndarray, "state action"]
    iterations: int
    slope: float


def fit(
    mdp: TabularMDP,
    groups: Sequence[Group],
    settings: Settings,
    start: Float[np.ndarray, "state action"] | None = None,
) -> Fit:
    """Find f.

    Args:
        mdp: The dynamics.
        groups: Demonstrations by the reward that explains them; weights sum to 1.
        settings: Horizon and numbers.
        start: Where to begin; 0 by default.

    Raises:
        UserError: If there is no group, a shape is wrong, or a number is not finite.
    """
    if not groups:
        raise UserError("no demonstrators: pass at least one group")
    for group in groups:
        check_reward(mdp, group.visits, "visits")
        check_reward(mdp, group.centre, "centre")
    demonstrated = sum(group.weight * group.visits for group in groups)
    shrinkage = settings.shrinkage * (demonstrated + settings.spread)
    shape = (mdp.n_states, mdp.n_actions)

    def loss(flat: np.ndarray) -> tuple[float, np.ndarray]:
        f = flat.reshape(shape)
        value = float((demonstrated * f - shrinkage * f**2).sum())
        slope = demonstrated - 2.0 * shrinkage * f
        for group in groups:
            best = soft_horizon_optimum(
                mdp, group.centre + f, settings.horizon, settings.temperature
            )
            reached = horizon_evaluation(mdp, best.probabilities, settings.horizon).visits
            value -= group.weight * best.value
            slope = slope - group.weight * reached
        return -value, -slope.ravel()

    begin = np.zeros(shape) if start is None else start
    options = {
        "maxiter": settings.max_iterations,
        "maxfun": 2 * settings.max_iterations,
        "gtol": settings.tolerance,
        "ftol": 0.0,  # the derivative alone decides
    }
    found = minimize(loss, begin.ravel(), jac=True, method="L-BFGS-B", options=options)
    return Fit(found.x.reshape(shape), int(found.nit), float(np.abs(found.jac).max()))
