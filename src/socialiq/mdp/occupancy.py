"""Discounted occupancy measure ρ of a policy, as in IQ-Learn."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import splu

from socialiq.errors import UserError
from socialiq.mdp.tabular import TabularMDP


def discounted_occupancy(
    mdp: TabularMDP, policy: Float[np.ndarray, "state action"], discount: float
) -> Float[np.ndarray, "state action"]:
    """Return ρ(s, a) = (1 - γ) Σ_t γ^t P(s_t = s, a_t = a) (thesis 2.2.2; Garg et al. 2021).

    The sum over states and actions is (1 - γ) times the expected discounted length of an episode:
    1 if episodes never end, less otherwise. For this measure
    E_ρ[V(s) - γ V(s')] = (1 - γ) E_p0[V(s_0)], with V(s') = 0 where the episode ends.

    Args:
        mdp: The dynamics.
        policy: Action probabilities.
        discount: γ in [0, 1).

    Raises:
        UserError: If the policy is not a distribution, or the discount is outside [0, 1).
    """
    if not 0.0 <= discount < 1.0:
        raise UserError(f"discount {discount:g} is outside [0, 1): an occupancy needs it below 1")
    system = eye_array(mdp.n_states) - discount * mdp.under(policy)
    states = splu(csc_array(system)).solve((1.0 - discount) * mdp.initial, trans="T")
    return states[:, None] * policy
