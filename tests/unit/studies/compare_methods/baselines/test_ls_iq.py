import numpy as np
import pytest

from socialiq.learners.iq_learn.objective import Batches
from socialiq.learners.state import stack
from socialiq.types import Ending
from studies.compare_methods.baselines.online import (
    LSIQ,
    LSIQConfig,
    LSIQHyperparameters,
)


@pytest.mark.parametrize("c", [0.5, 2.0])
def test_chi2_on_the_mixture_is_least_squares(c):
    """-E_E[r] + E_π[r] + c/2 (E_E[r²] + E_π[r²]), completed to squares around ±1/c."""
    rng = np.random.default_rng(0)
    expert, own = rng.normal(size=(2, 50))
    objective = own.mean() - expert.mean() + c / 2 * ((expert**2).mean() + (own**2).mean())
    squares = c / 2 * (((expert - 1 / c) ** 2).mean() + ((own + 1 / c) ** 2).mean())
    assert objective == pytest.approx(squares - 1 / c)


@pytest.mark.parametrize("fixed", [True, False])
def test_the_loss_by_hand(constant, rows_of, fixed):
    """c = 0.5, γ = 0.5: rewards ±2, values within ±4, so V(s') = ln(e^9 + e^9) is cut to 4.

    The expert's row goes on and the learner's ends, alone, so that the state after it has the
    reward -2 and the value -4.
    """
    network, slow = constant(1.0, 3.0), constant(9.0, 9.0)
    batches = Batches(rows_of([1], [0.0], ending=0), rows_of([0], [0.0]), None)
    learner = LSIQ(LSIQConfig(prior="none", fixed_target=fixed), (1, 2))
    run = stack([LSIQHyperparameters(regularisation=0.5, discount=0.5)])[0]
    _, terms = learner.loss(network, slow, batches, run)
    assert terms["expert"] == pytest.approx((3 - 4) ** 2 / 2)  # 2 + 0.5 4, and 2 / 0.5
    assert terms["own"] == pytest.approx((1 - (-2 + 0.5 * -4)) ** 2 / 2)


@pytest.mark.parametrize(("own_ends", "value"), [(True, 2.0), (False, 4.0)])
def test_the_absorbing_state_has_the_mean_reward_of_those_that_end_there(
    constant, rows_of, own_ends, value
):
    """Three demonstrations end, and one own row or none: 2 (3 - 1) / 4 = 1, and 2; γ = 0.5."""
    expert = rows_of([0, 0, 0], [0.0] * 3)
    own = rows_of([0], [0.0], ending=int(Ending.ARRIVAL) if own_ends else 0)
    learner = LSIQ(LSIQConfig(prior="none", fixed_target=False), (1, 2))
    run = stack([LSIQHyperparameters(regularisation=0.5, discount=0.5)])[0]
    network = constant(0.0, 0.0)
    _, terms = learner.loss(network, network, Batches(expert, own, None), run)
    assert terms["expert"] == pytest.approx((2 + 0.5 * value) ** 2 / 2)
