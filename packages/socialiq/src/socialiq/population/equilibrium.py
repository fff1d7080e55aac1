"""Logit equilibria of games of two players who move at the same time, many games side by side."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from socialiq.errors import UserError

_FIRST_STEP = 0.03
_BEND = 0.95  # cosine of the largest turn of a step
_RESIDUAL = 1e-9
_NEWTON_STEPS = 6
_MAX_STEPS = 5_000


class Strategies(NamedTuple):
    """Chances of the actions of both players, by game."""

    first: Float[np.ndarray, "game action"]
    second: Float[np.ndarray, "game action"]


class _Games(NamedTuple):
    """Payoffs of games.

    A point of a game's branch has the logarithms of both players' chances, and the precision 1/τ.
    """

    first: Float[np.ndarray, "game action action"]  # payoffs, by own and other's action
    second: Float[np.ndarray, "game action action"]  # of the second player, by own action first
    symmetric: Bool[np.ndarray, " game"]

    def of(self, rows: np.ndarray) -> "_Games":
        return _Games(self.first[rows], self.second[rows], self.symmetric[rows])


def logit_equilibrium(
    first: Float[np.ndarray, "game action action"],
    second: Float[np.ndarray, "game action action"],
    temperature: float,
) -> Strategies:
    """Return the logit equilibrium of each game, on the branch that begins at full noise.

    Each player draws an action from softmax(expected payoff/τ), given the chances of its opponent.
    A game may have several such equilibria at a small τ. The branch from τ = ∞ is one of them
    (McKelvey and Palfrey 1995); it is followed by its arc length (Turocy 2005). In a symmetric game
    it is the symmetric one, so that equal drivers behave equally.

    Args:
        first: Payoffs of the first player, by the first's and the second's action.
        second: Payoffs of the second player, by the first's and the second's action.
        temperature: τ, in units of the payoffs.

    Raises:
        UserError: If τ is not positive, or a branch could not be followed to τ.
    """
    if not temperature > 0.0:
        raise UserError(f"temperature {temperature:g} is not positive")
    count, actions, _ = first.shape
    transposed = second.transpose(0, 2, 1)
    symmetric = np.abs(first - transposed).max(axis=(1, 2)) < 1e-9
    branches = _Games(first, transposed, symmetric)
    points = np.full((count, 2 * actions + 1), -np.log(actions))
    points[:, -1] = 0.0
    end = np.zeros_like(points)
    end[:, -1] = 1.0
    tangents, signs = _tangents(branches, points, end)
    steps = np.full(count, _FIRST_STEP)
    running = np.arange(count)
    for _ in range(_MAX_STEPS):
        if not len(running):
            break
        games = branches.of(running)
        before = points[running]
        step = steps[running]
        tangent = tangents[running]
        after, first_change = _corrected(games, before + step[:, None] * tangent, tangent)
        residual, _ = _equations(games, after)
        turned, sign = _tangents(games, after, tangent)
        is_good = (turned * tangent).sum(axis=1) > _BEND
        is_good &= np.abs(residual).max(axis=1) < _RESIDUAL
        is_good &= first_change < 0.3 * step
        # On a branch the sign changes at a bifurcation only, which a symmetric game may have.
        is_good &= games.symmetric | (sign == signs[running])
        arrives = is_good & (after[:, -1] >= 1.0 / temperature)
        ahead = is_good & ~arrives
        points[running[ahead]] = after[ahead]
        tangents[running[ahead]] = turned[ahead]
        longer = np.where(first_change < 0.05 * step, 1.6 * step, step)
        steps[running] = np.where(is_good, longer, step / 2)
        if arrives.any():
            share = (1.0 / temperature - before[:, -1]) / (after[:, -1] - before[:, -1])
            between = before + share[:, None] * (after - before)
            ended, _ = _corrected(games.of(arrives), between[arrives], end[: arrives.sum()])
            points[running[arrives]] = ended
        running = running[~arrives]
    residual, _ = _equations(branches, points)
    if len(running) or np.abs(residual).max() > _RESIDUAL:
        raise UserError(f"no equilibrium was reached at temperature {temperature:g}: raise it")
    return Strategies(np.exp(points[:, :actions]), np.exp(points[:, actions:-1]))


def _equations(
    games: _Games, points: Float[np.ndarray, "game unknown"]
) -> tuple[Float[np.ndarray, "game equation"], Float[np.ndarray, "game equation unknown"]]:
    """Return the residuals of the equilibrium's equations, and their derivatives.

    For each player: the chances add up to 1, and the logarithms of two chances differ by the
    precision times the difference of the expected payoffs.
    """
    actions = games.first.shape[1]
    residual = np.zeros((len(points), 2 * actions))
    slope = np.zeros((len(points), 2 * actions, 2 * actions + 1))
    precision = points[:, -1]
    for player, payoffs in enumerate((games.first, games.second)):
        columns = slice(player * actions, (player + 1) * actions)
        opponent = slice((1 - player) * actions, (2 - player) * actions)
        sums = columns.start
        rows = slice(columns.start + 1, columns.stop)
        chances = np.exp(points[:, columns])
        answers = np.exp(points[:, opponent])
        gains = payoffs[:, 1:] - payoffs[:, :1]
        expected = np.einsum("gab,gb->ga", gains, answers)
        residual[:, sums] = chances.sum(axis=1) - 1.0
        residual[:, rows] = (
            points[:, rows] - points[:, columns][:, :1] - precision[:, None] * expected
        )
        slope[:, sums, columns] = chances
        slope[:, rows, columns.start] = -1.0
        slope[:, rows, rows] += np.eye(actions - 1)
        slope[:, rows, opponent] = -precision[:, None, None] * gains * answers[:, None]
        slope[:, rows, -1] = -expected
    return residual, slope


def _corrected(
    games: _Games,
    points: Float[np.ndarray, "game unknown"],
    normals: Float[np.ndarray, "game unknown"],
) -> tuple[Float[np.ndarray, "game unknown"], Float[np.ndarray, " game"]]:
    """Return the points of the branches in the planes of the normals, and Newton's first change."""
    half = games.first.shape[1]
    first_change = np.zeros(len(points))
    for number in range(_NEWTON_STEPS):
        residual, system = _systems(games, points, normals)
        right = np.concatenate([-residual, np.zeros((len(points), 1))], axis=1)
        change = np.linalg.solve(system, right[..., None])[..., 0]
        if number == 0:
            first_change = np.linalg.norm(change, axis=1)
        points = points + change
        # No logarithm of a chance is above 0; far above, its exponential would overflow.
        points[:, :-1] = np.minimum(points[:, :-1], 1.0)
        swapped = np.concatenate([points[:, half:-1], points[:, :half], points[:, -1:]], axis=1)
        points = np.where(games.symmetric[:, None], (points + swapped) / 2, points)
    return points, first_change


def _tangents(
    games: _Games,
    points: Float[np.ndarray, "game unknown"],
    before: Float[np.ndarray, "game unknown"],
) -> tuple[Float[np.ndarray, "game unknown"], Float[np.ndarray, " game"]]:
    """Return unit tangents that go on in the direction before, and the signs of their side."""
    _, system = _systems(games, points, before)
    right = np.zeros((*points.shape, 1))
    right[:, -1] = 1.0
    tangents = np.linalg.solve(system, right)[..., 0]
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    system[:, -1] = tangents
    return tangents, np.sign(np.linalg.det(system))


def _systems(
    games: _Games,
    points: Float[np.ndarray, "game unknown"],
    last: Float[np.ndarray, "game unknown"],
) -> tuple[Float[np.ndarray, "game equation"], Float[np.ndarray, "game unknown unknown"]]:
    """Return the residuals, and the derivatives above a last row that makes them square.

    Nothing is singular exactly, which a symmetric game is at one point of its branch.
    """
    residual, slope = _equations(games, points)
    square = np.concatenate([slope, last[:, None]], axis=1)
    return residual, square + 1e-14 * np.eye(square.shape[-1])
