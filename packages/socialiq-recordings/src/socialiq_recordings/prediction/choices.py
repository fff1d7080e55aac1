"""Choices of recorded drivers: at each decision some accelerations, and what each would bring.

A row is a decision. All of a row but the observed acceleration is known at its time, and the
base predictor was trained without the vehicles of the row's chain. A driver of angle α chooses
with p(a | s, α) proportional to p_base(a | s) exp(β R(α)), R(α) = cos α r_env + sin α r_social
(Eq 4.3).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float64, Int64

from socialiq.errors import UserError

_SUM = 1e-6  # by which probabilities of a row may miss 1


@dataclass(frozen=True, eq=False)
class ChoiceTable:
    """Decisions of recorded drivers on a grid of accelerations.

    Attributes:
        driver: Number of the vehicle, one number over all recordings.
        chain: Number of the chain of recordings; different chains share no vehicle.
        site: Number of the site.
        time: s on the recording's clock; ascending within a driver.
        half: 0 in the first half of the driver's conflicts, 1 in the second. An angle is inferred
            from the first and scored on the second.
        conflict: Whether the driver and another vehicle are on course for one conflict area.
        moving: Whether the vehicle moves.
        grid: Accelerations to choose from, m/s², ascending and equally spaced.
        log_base: Log-probability of each by the base predictor; a row's probabilities sum to 1.
        r_env: What each brings the driver: seconds of its own travel time saved, against keeping
            its speed.
        r_social: What each brings others: minus the seconds that they lose against the driver's
            absence.
        acceleration: Observed mean of the next second, m/s².
        residual: Observed minus expected acceleration of the driver's decision before, m/s²; 0
            where there is none.

    Raises:
        UserError: If columns don't fit together, or a number is not finite.
    """

    driver: Int64[np.ndarray, " decision"]
    chain: Int64[np.ndarray, " decision"]
    site: Int64[np.ndarray, " decision"]
    time: Float64[np.ndarray, " decision"]
    half: Int64[np.ndarray, " decision"]
    conflict: Bool[np.ndarray, " decision"]
    moving: Bool[np.ndarray, " decision"]
    grid: Float64[np.ndarray, " candidate"]
    log_base: Float64[np.ndarray, "decision candidate"]
    r_env: Float64[np.ndarray, "decision candidate"]
    r_social: Float64[np.ndarray, "decision candidate"]
    acceleration: Float64[np.ndarray, " decision"]
    residual: Float64[np.ndarray, " decision"]

    # Run-time type checkers leave the constructor to `__post_init__`, whose lines say what to do.
    __no_type_check__: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check every column."""
        grid, decisions = self.grid, len(self.driver)
        steps = np.diff(grid) if grid.ndim == 1 else np.zeros(0)
        if len(steps) < 1 or not (steps > 0).all() or np.ptp(steps) > 1e-9 * len(grid):
            raise UserError("grid must be two or more ascending, equally spaced accelerations")
        for one in fields(self):
            column = getattr(self, one.name)
            wide = one.name in ("log_base", "r_env", "r_social")
            shape = (decisions, len(grid)) if wide else (decisions,)
            if one.name != "grid" and column.shape != shape:
                raise UserError(f"column {one.name} has the shape {column.shape}, not {shape}")
            if column.dtype.kind == "f" and not np.isfinite(column).all():
                raise UserError(f"column {one.name} holds a number that is not finite")
        if decisions and np.abs(np.exp(self.log_base).sum(axis=1) - 1).max() > _SUM:
            raise UserError("log_base must be log-probabilities that sum to 1 in each row")
        if not np.isin(self.half, (0, 1)).all():
            raise UserError("half must be 0 or 1")

    def __len__(self) -> int:
        """Return the number of decisions."""
        return len(self.driver)

    @property
    def chosen(self) -> Int64[np.ndarray, " decision"]:
        """Index of the acceleration of the grid that is closest to the observed one."""
        return nearest(self.grid, self.acceleration)

    def rows(self, mask: Bool[np.ndarray, " decision"]) -> ChoiceTable:
        """Return only some decisions.

        Args:
            mask: Those to keep.
        """
        kept = {f.name: getattr(self, f.name)[mask] for f in fields(self) if f.name != "grid"}
        return replace(self, **kept)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all columns by name."""
        return {one.name: getattr(self, one.name) for one in fields(self)}


def nearest(grid: Float64[np.ndarray, " candidate"], values: Any) -> Int64[np.ndarray, " decision"]:
    """Return the index of the closest acceleration of an equally spaced grid.

    Args:
        grid: m/s², ascending.
        values: m/s², one for each decision.
    """
    place = np.rint((np.asarray(values) - grid[0]) / (grid[1] - grid[0]))
    return np.clip(place, 0, len(grid) - 1).astype(np.int64)
