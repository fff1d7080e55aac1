"""Two drivers with angles meet at a crossing of the 7x7 world and move at the same time (9.4).

Both know both angles. Each is scored by its own r_env and that of its opponent, which is what it
causes: R(α) = cos α · own + sin α · opponent's. The logit equilibrium follows by backward
induction.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from socialiq.errors import UserError
from socialiq.population.equilibrium import logit_equilibrium
from socialiq.social.angle import check_angle
from socialiq.worlds.crossing7 import CONFLICT, ENV_WEIGHTS, FAST, LAST

ACTIONS = FAST + 1  # STOP, SLOW, FAST
STARTS = (0, 0), (0, 1), (1, 0), (0, 2), (2, 0)
"""Cells of the two drivers at the start, equally likely."""


class Payoffs(NamedTuple):
    """Expectations for a driver (row) who meets another one (column), by their angles."""

    r_env: Float[np.ndarray, "angle angle"]  # own sum of an episode
    collision: Float[np.ndarray, "angle angle"]
    steps: Float[np.ndarray, "angle angle"]  # until the own arrival, a collision, or the horizon


class Moves(NamedTuple):
    """Results of both actions in both cells, (cell, cell, action, action)."""

    after: tuple[Int[np.ndarray, "x y a b"], Int[np.ndarray, "x y a b"]]
    r_env: tuple[Float[np.ndarray, "x y a b"], Float[np.ndarray, "x y a b"]]
    collision: Bool[np.ndarray, "x y a b"]
    underway: Bool[np.ndarray, "x y a b"]  # of the first driver
    is_over: Bool[np.ndarray, "x y a b"]


@dataclass(frozen=True)
class CrossingGame:
    """Rules of a meeting; speeds, cells and rewards are those of crossing7."""

    temperature: float = 0.05
    """τ of both drivers, in units of the rewards."""
    horizon: int = 12
    """Steps after which a meeting ends."""

    def payoffs(self, angles: tuple[float, ...]) -> Payoffs:
        """Return the payoffs of all pairs of angles, in degrees.

        Raises:
            UserError: If an angle is none, or an equilibrium can't be reached.
        """
        for angle in angles:
            check_angle(angle)
        if self.horizon < 1:
            raise UserError(f"horizon {self.horizon} must be at least 1")
        rows, columns = np.indices((len(angles), len(angles))).reshape(2, -1)
        weights = np.stack([np.cos(np.radians(angles)), np.sin(np.radians(angles))], axis=1)
        moves = joint_moves()
        cells = np.zeros((len(rows), LAST + 1, LAST + 1))
        values = dict.fromkeys(("first", "second", "collision", "steps"), cells)
        for _ in range(self.horizon):
            continued = {
                name: np.where(moves.is_over, 0.0, value[:, *moves.after])
                for name, value in values.items()
            }
            first, second = (
                reward + continued[name]
                for name, reward in zip(("first", "second"), moves.r_env, strict=True)
            )
            outcomes = {
                "first": first,
                "second": second,
                "collision": moves.collision + continued["collision"],
                "steps": moves.underway + continued["steps"],
            }
            scores = (
                _weighted(weights[rows], first, second),
                _weighted(weights[columns], second, first),
            )
            games = [score.reshape(-1, ACTIONS, ACTIONS) for score in scores]
            strategies = logit_equilibrium(games[0], games[1], self.temperature)
            chances = [chance.reshape(*cells.shape, ACTIONS) for chance in strategies]
            values = {
                name: np.einsum("gxyab,gxya,gxyb->gxy", outcome, *chances)
                for name, outcome in outcomes.items()
            }
        shape = len(angles), len(angles)
        means = {
            name: np.mean([value[:, *start] for start in STARTS], axis=0).reshape(shape)
            for name, value in values.items()
        }
        return Payoffs(means["first"], means["collision"], means["steps"])


def joint_moves() -> Moves:
    """Return the moves of both drivers; one that has arrived stays, and gets 0.

    Both collide if they occupy the conflict cell in the same step, by crossing7's `swept` rule.
    """
    cells = np.arange(LAST + 1)
    actions = np.arange(ACTIONS)
    before = np.meshgrid(cells, cells, actions, actions, indexing="ij")
    positions = before[:2]
    steps = before[2:]
    arrived = [position == LAST for position in positions]
    after = tuple(
        np.minimum(position + step, LAST) for position, step in zip(positions, steps, strict=True)
    )
    entered = [
        (reached == CONFLICT) | ((position < CONFLICT) & (reached >= CONFLICT))
        for position, reached in zip(positions, after, strict=True)
    ]
    collision = entered[0] & entered[1] & ~arrived[0] & ~arrived[1]
    r_env = []
    for reached, step, done in zip(after, steps, arrived, strict=True):
        on_road = ENV_WEIGHTS["speed"] * step / FAST + ENV_WEIGHTS["step"]
        reward = np.where(reached == LAST, ENV_WEIGHTS["arrival"], on_road)
        reward = np.where(collision, ENV_WEIGHTS["collision"], reward)
        r_env.append(np.where(done, 0.0, reward))
    is_over = collision | ((after[0] == LAST) & (after[1] == LAST))
    return Moves((after[0], after[1]), (r_env[0], r_env[1]), collision, ~arrived[0], is_over)


def _weighted(weights: np.ndarray, driver: np.ndarray, other_driver: np.ndarray) -> np.ndarray:
    """Return cos α · own + sin α · other's (thesis 4.2), by game."""
    cosine, sine = weights.T[..., None, None, None, None]
    return cosine * driver + sine * other_driver
