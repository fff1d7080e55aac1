import dataclasses

import pytest

from socialiq.errors import UserError
from socialiq.learners.dqn import DQNConfig, DQNHyperparameters

NAN, INF = float("nan"), float("inf")


@pytest.mark.usefixtures("as_a_user_runs_it")
@pytest.mark.parametrize(
    "fields",
    [
        {"view": "round"},
        {"activation": "gelu"},
        {"batch_size": 0},
        {"steps": 0},
        {"steps_per_update": 0},
        {"replay_capacity": 0},
        {"hidden": (8, 0)},
    ],
    ids=str,
)
def test_a_structure_that_makes_no_run_is_refused(fields):
    with pytest.raises(UserError) as caught:
        DQNConfig(**fields)
    assert "\n" not in str(caught.value)
    assert next(iter(fields)) in str(caught.value)


@pytest.mark.parametrize(
    "fields",
    [
        *({"angle": value} for value in (-1.0, 360.0, NAN, INF)),
        *({"learning_rate": value} for value in (0.0, -1e-3, NAN, INF)),
        *({"final_learning_rate": value} for value in (0.0, -1e-3, NAN, INF)),
        *({"discount": value} for value in (-0.1, 1.0, NAN)),
        *({"polyak": value} for value in (0.0, 1.1, NAN)),
        *({"exploration": value} for value in (-0.1, 1.1, NAN)),
        *({"exploration_fall": value} for value in (-0.1, 1.1, NAN)),
        *({"seed": value} for value in (-1, 2**32)),
    ],
    ids=str,
)
def test_a_number_outside_its_range_is_refused(fields):
    with pytest.raises(UserError) as caught:
        DQNHyperparameters(**fields)
    assert "\n" not in str(caught.value)
    assert next(iter(fields)) in str(caught.value)


@pytest.mark.parametrize(
    "fields",
    [
        {"angle": 359.9},
        {"discount": 0.0},
        {"polyak": 1.0},
        {"exploration": 0.0},
        {"exploration": 1.0},
        {"exploration_fall": 0.0},
        {"exploration_fall": 1.0},
        {"seed": 2**32 - 1},
    ],
    ids=str,
)
def test_a_number_at_the_edge_is_accepted(fields):
    hyperparameters = DQNHyperparameters(**fields)
    assert all(getattr(hyperparameters, name) == value for name, value in fields.items())


def test_exploration_falls_in_a_straight_line_and_stays():
    hyperparameters = DQNHyperparameters(exploration=0.2, exploration_fall=0.5)
    found = [hyperparameters.exploring(progress) for progress in (0.0, 0.125, 0.25, 0.5, 0.75, 1.0)]
    assert found == pytest.approx([1.0, 0.8, 0.6, 0.2, 0.2, 0.2])
    assert dataclasses.replace(hyperparameters, exploration_fall=0.0).exploring(0.0) == 0.2


@pytest.mark.parametrize(
    ("steps", "updates"), [(480, 10), (479, 9), (48, 1), (1, 1), (5_000_000, 104_166)]
)
def test_updates_are_the_whole_ones_that_the_steps_pay_for(steps, updates):
    assert DQNConfig(steps=steps, steps_per_update=48).updates == updates
