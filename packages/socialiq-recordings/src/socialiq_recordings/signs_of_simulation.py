"""Signs that a recording was simulated."""

import re

import numpy as np

from socialiq_recordings.recording import Tracks

_WORDS = re.compile(
    r"simulat|synthetic|\b(sumo|carla|vissim|aimsun|paramics|matsim|highway-?env|metadrive|nuplan "
    r"closed.loop|ego swap)\b",
    re.IGNORECASE,
)
_NOT_SIMULATED = re.compile(r"next[ -]generation simulation", re.IGNORECASE)  # NGSIM's name
_HEADER = ("source", "made_by", "tags", "author", "generator")

EXACT = 2e-4
"""m; positions that follow from the stated velocities to this are computed. Of the twelve scenarios
of NGSIM the median is 0.0006 to 0.012."""

STRAIGHT = 1e-3
"""m; root mean square beside a straight line in 1.5 s. No driver steers so, but a rule does."""

REPEATED = 0.05
"""Share of changing seconds that another vehicle repeats; at most 0.009 among the twelve."""

CHANCE = 0.01
"""Largest probability of as many repeating vehicles where one in twenty repeats. Seconds of one
vehicle overlap: in a clip of two seconds one pair of equal tracks is no simulation."""

_MOVING = 2.0  # m/s
_CHANGE = 0.3  # m/s, in a second
_FEWEST = 20  # steps or seconds from which a share is judged


def signs_of_simulation(tracks: Tracks) -> tuple[str, ...]:
    """Return the reasons to take a recording as simulated; empty if there are none.

    Its header names a simulator, it has no noise, or seconds are repeated exactly.
    """
    signs = []
    for name in _HEADER:
        text = _NOT_SIMULATED.sub("", str(tracks.source.get(name, "")))
        if match := _WORDS.search(text):
            signs.append(f"its {name} names '{match[0].lower()}'")
            break
    if _exact(tracks) and _straight(tracks):
        signs.append("no noise: positions integrate the velocities and most paths are straight")
    share = _repeated_share(tracks)
    if share >= REPEATED:
        signs.append(f"{100 * share:.0f} % of the seconds are repeated exactly by other vehicles")
    return tuple(signs)


def _exact(tracks: Tracks) -> bool:
    """Whether positions are those of Euler's or the trapezoidal rule of the velocities."""
    row = np.flatnonzero(np.diff(tracks.track) == 0)
    row = row[np.hypot(tracks.vx[row], tracks.vy[row]) >= _MOVING]
    if len(row) < _FEWEST:
        return False
    after = row + 1
    dx = tracks.x[after] - tracks.x[row]
    dy = tracks.y[after] - tracks.y[row]
    residuals = []
    for share in (0.0, 0.5, 1.0):
        vx, vy = ((1 - share) * v[row] + share * v[after] for v in (tracks.vx, tracks.vy))
        residuals.append(np.median(np.hypot(dx - vx * tracks.dt, dy - vy * tracks.dt)))
    return bool(min(residuals) <= EXACT)


def _straight(tracks: Tracks) -> bool:
    """Whether half of the paths of 1.5 s are straight."""
    length = max(4, round(1.5 / tracks.dt))
    rows = np.arange(0, max(tracks.n_states - length, 0), max(1, length // 2))
    rows = rows[tracks.track[rows] == tracks.track[rows + length]]
    points = np.stack([tracks.x, tracks.y], axis=1)[rows[:, None] + np.arange(length + 1)]
    points = points[np.hypot(*(points[:, -1] - points[:, 0]).T) >= 1.5 * _MOVING]
    apart = points - points.mean(axis=1, keepdims=True)
    spread = np.linalg.eigvalsh(np.swapaxes(apart, 1, 2) @ apart / (length + 1))[:, 0]
    return bool(len(points) and (spread <= STRAIGHT**2).mean() >= 0.5)


def _repeated_share(tracks: Tracks) -> float:
    length = max(4, round(1 / tracks.dt))
    rows = np.arange(max(tracks.n_states - length, 0))
    rows = rows[tracks.track[rows] == tracks.track[rows + length]]
    speed = np.round(np.hypot(tracks.vx, tracks.vy), 4)
    seconds = speed[rows[:, None] + np.arange(length + 1)]
    # A constant acceleration is no pattern: only what bends identifies a second.
    bends = np.abs(np.diff(seconds, n=2, axis=1)).max(axis=1, initial=0.0) > 1e-3
    keep = (np.ptp(seconds, axis=1) >= _CHANGE) & bends if len(rows) else np.zeros(0, bool)
    if keep.sum() < _FEWEST:
        return 0.0
    group = np.unique(seconds[keep], axis=0, return_inverse=True)[1].ravel()
    track = tracks.track[rows[keep]]
    low = np.full(group.max() + 1, 1 << 30)
    high = np.zeros(group.max() + 1, np.int64)
    np.minimum.at(low, group, track)
    np.maximum.at(high, group, track)
    repeats = low[group] != high[group]
    if repeats.mean() < REPEATED:
        return 0.0
    from scipy.special import bdtrc  # slow to import

    vehicles = len(np.unique(track))
    repeating = len(np.unique(track[repeats]))
    by_chance = bdtrc(repeating - 1, vehicles, REPEATED) > CHANCE
    return 0.0 if by_chance else float(repeats.mean())
