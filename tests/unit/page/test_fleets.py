"""Fleets of the page: which cars are at the angle, and the committed rates."""

import numpy as np
import pytest
from tests.page_core.fleets import chosen_cars, rates_of

from socialiq.nn.dial_policy import DialPolicy
from socialiq.page.data import ANGLES
from socialiq.page.fleets import COUNTS, DIALS, OPTIONS, fleet_data
from socialiq.storage import packaged_results


def test_cars_at_the_angle_follow_in_turn_from_the_one_of_the_seed():
    chosen = chosen_cars(np.array([6, 8]), 4)
    assert chosen.tolist() == [[1, 1, 0, 0, 0, 0, 1, 1], [1, 1, 1, 1, 0, 0, 0, 0]]
    assert (chosen_cars(np.arange(16), 1).sum(axis=0) == 2).all()


def test_rates_of_few_episodes_are_what_was_counted():
    dial = DialPolicy.load(packaged_results() / DIALS[1])
    row = rates_of(dial, 75.0, 8, np.array([1, 2]))
    assert row["arrival"] + row["collision"] + row["timeout"] == pytest.approx(1.0)
    assert row["per_minute"] * 1.0 == pytest.approx(
        60 * 16 * row["arrival"] / 60.0
    )  # both end by time
    assert row["per_minute_low"] <= row["per_minute"] <= row["per_minute_high"]


def rates_on_page():
    columns = fleet_data(measured=True)["rates"]
    return [
        dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)
    ]


def test_every_dial_was_measured_with_every_number_of_cars():
    rates = rates_on_page()
    measured = {(row["dial"], row["angle"], row["count"]) for row in rates}
    assert len(measured) == len(rates) == len(DIALS) * 7 * len(COUNTS)
    assert {row["angle"] for row in rates} <= {*map(float, ANGLES)}
    assert max(COUNTS) == OPTIONS.agents
    assert fleet_data(measured=False)["rates"] == {}


@pytest.mark.slow
def test_a_committed_rate_is_what_the_command_measures():
    rates = rates_on_page()
    (row,) = [row for row in rates if (row["dial"], row["angle"], row["count"]) == (2, 45.0, 8)]
    dial = DialPolicy.load(packaged_results() / DIALS[2])
    again = rates_of(dial, 45.0, 8, np.arange(1, row["episodes"] + 1))
    for name in ("per_minute", "collision", "timeout"):
        assert again[name] == pytest.approx(row[name], abs=0.002), name
