from dataclasses import replace

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.prediction.choices import ChoiceTable, nearest


def _table(decisions: int = 4) -> ChoiceTable:
    grid = np.array([-1.0, 0.0, 1.0])
    whole, half = np.arange(decisions), np.zeros(decisions)
    return ChoiceTable(
        driver=whole,
        chain=whole,
        time=half,
        half=whole % 2,
        conflict=whole > 1,
        grid=grid,
        log_base=np.full((decisions, 3), -np.log(3.0)),
        r_env=np.tile(grid, (decisions, 1)),
        r_social=np.zeros((decisions, 3)),
        acceleration=np.linspace(-2.0, 0.6, decisions),
        residual=half,
    )


def test_the_chosen_acceleration_is_the_closest_and_the_ends_take_what_is_beyond() -> None:
    assert nearest(np.array([-1.0, 0.0, 1.0]), [-9.0, -0.4, 0.6, 9.0]).tolist() == [0, 1, 2, 2]


def test_selected_rows_keep_their_columns() -> None:
    table = _table()
    kept = table.rows(table.conflict)
    assert len(kept) == 2
    assert kept.driver.tolist() == [2, 3]
    assert kept.chosen.tolist() == table.chosen[2:].tolist()


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"grid": np.array([0.0, 1.0, 5.0])}, "equally spaced"),
        ({"time": np.zeros(3)}, "column time has the shape"),
        ({"r_env": np.full((4, 3), np.nan)}, "column r_env holds a number that is not finite"),
        ({"log_base": np.zeros((4, 3))}, "sum to 1"),
        ({"half": np.full(4, 2)}, "half must be 0 or 1"),
    ],
)
def test_columns_that_do_not_fit_are_refused(change: dict[str, np.ndarray], line: str) -> None:
    with pytest.raises(UserError, match=line):
        replace(_table(), **change)
