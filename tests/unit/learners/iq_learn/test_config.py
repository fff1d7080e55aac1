import pytest

from socialiq.errors import UserError
from socialiq.learners.iq_learn.config import Endings, IQLearnConfig, IQLearnHyperparameters
from socialiq.types import Ending

NAN, INF = float("nan"), float("inf")
untyped = pytest.mark.usefixtures("as_a_user_runs_it")


def test_defaults_are_the_gridworld_column_of_table_c_1():
    hyperparameters, static = IQLearnHyperparameters(), IQLearnConfig()
    assert (hyperparameters.temperature, hyperparameters.discount, hyperparameters.chi2_alpha) == (
        1.0,
        0.99,
        0.5,
    )
    assert (hyperparameters.learning_rate, hyperparameters.polyak) == (3e-4, 0.005)
    assert (static.hidden, static.batch_size, static.value_term) == ((64, 64), 64, "value")
    assert static.social_discount == 0.99


@untyped
@pytest.mark.parametrize(
    "fields",
    [
        {"prior": "tikhonov"},
        {"target_kind": "cumulative"},
        {"divergence": "tv"},
        {"value_term": "v1"},
        {"chi2_on": "replay"},
        {"next_value": "slow"},
        {"activation": "gelu"},
        {"batch_size": 0},
        {"updates": 0},
        {"env_steps_per_update": 0},
        {"replay_capacity": 0},
        {"hidden": (8, 0)},
        {"social_discount": NAN},
        {"social_discount": -0.1},
        {"social_discount": 1.1},
        {"online": False},
        {"online": False, "value_term": "v0", "chi2_on": "mixture"},
        {"prior": "shifted_chi2", "divergence": "kl"},
        {"prior": "shifted_chi2", "chi2_on": "mixture", "target_kind": "running"},
        {"bounded": True},
        {"bounded": True, "prior": "none"},
        {"endings": Endings(other="occupancy"), "chi2_on": "mixture"},
        {"bounded": True, "prior": "none", "chi2_on": "mixture", "divergence": "kl"},
        {"schedule": "cosine"},
        {"averaging": 1.5},
        {"input_scale": 0.0},
        {"input_scale": 2.0, "view": "set"},
    ],
    ids=str,
)
def test_a_structure_that_makes_no_run_is_refused(fields):
    with pytest.raises(UserError) as caught:
        IQLearnConfig(**fields)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "fields",
    [
        {"online": False, "value_term": "value_expert"},
        {"online": False, "value_term": "v0"},
        {"prior": "shifted_chi2", "chi2_on": "mixture", "target_kind": "instantaneous"},
        {"hidden": ()},
        {"social_discount": 1.0},
    ],
    ids=str,
)
def test_a_structure_at_the_edge_is_accepted(fields):
    static = IQLearnConfig(**fields)
    assert all(getattr(static, name) == value for name, value in fields.items())


@untyped
def test_an_unknown_name_is_told_with_the_known_ones():
    with pytest.raises(
        UserError, match="unknown value of --set value_term 'v1': choose one of value, value_expe"
    ):
        IQLearnConfig(value_term="v1")


@untyped
@pytest.mark.parametrize("kind", ["arrival", "collision", "timeout", "other"])
def test_an_unknown_treatment_of_an_ending_is_refused(kind):
    with pytest.raises(UserError, match=f"{kind}.* 'terminal': choose one of zero, bootstrap"):
        Endings(**{kind: "terminal"})


def test_endings_by_kind_name_every_ending():
    assert Endings(timeout="bootstrap").by_kind() == {
        Ending.ARRIVAL: "zero",
        Ending.COLLISION: "zero",
        Ending.TIMEOUT: "bootstrap",
        Ending.OTHER: "zero",
    }


@pytest.mark.parametrize(
    "fields",
    [
        *({"angle": value} for value in (-1.0, 360.0, NAN, INF)),
        *({"strength": value} for value in (-0.1, NAN, INF)),
        *({"prior_weight": value} for value in (-0.1, NAN, INF)),
        *({"temperature": value} for value in (0.0, -1.0, NAN, INF)),
        *({"chi2_alpha": value} for value in (0.0, NAN)),
        *({"learning_rate": value} for value in (0.0, -1e-3, NAN, INF)),
        *({"reweight_temperature": value} for value in (0.0, NAN)),
        *({"discount": value} for value in (-0.1, 1.0, NAN)),
        *({"polyak": value} for value in (0.0, 1.1, NAN)),
        *({"seed": value} for value in (-1, 2**32)),
        {"dataset": -1},
    ],
    ids=str,
)
def test_a_number_outside_its_range_is_refused(fields):
    with pytest.raises(UserError) as caught:
        IQLearnHyperparameters(**fields)
    assert "\n" not in str(caught.value)
    assert next(iter(fields)) in str(caught.value)


@pytest.mark.parametrize(
    "fields",
    [
        {"angle": 0.0},
        {"angle": 359.9},
        {"strength": 0.0},
        {"prior_weight": 0.0},
        {"discount": 0.0},
        {"polyak": 1.0},
        {"seed": 2**32 - 1},
    ],
    ids=str,
)
def test_a_number_at_the_edge_is_accepted(fields):
    hyperparameters = IQLearnHyperparameters(**fields)
    assert all(getattr(hyperparameters, name) == value for name, value in fields.items())
