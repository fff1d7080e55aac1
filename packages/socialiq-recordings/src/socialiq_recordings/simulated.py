"""Simulated episodes as recordings, and the signs that a recording was simulated.

All code for recordings can be tested without external data: the road becomes lanelets, and every
sub-step a frame. A vehicle that is spawned after a decision is recorded from the next sub-step,
because the simulator's observation of that decision precedes it.
"""

import re

import numpy as np
from scipy.special import bdtrc

from socialiq.physics import wrapped
from socialiq.types import Ending, Policy
from socialiq.worlds.highway.core import geometry as shapes
from socialiq.worlds.highway.core.compile import for_python
from socialiq.worlds.highway.network import EXIT
from socialiq.worlds.intersection.core import geometry
from socialiq.worlds.intersection.options import SPEED_LIMIT, Options
from socialiq.worlds.intersection.world import Batch
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Lanelet, RoadNetwork

FIRST_LANELET = 1000
"""Number of the first lanelet; lanelets are in the order of the simulator's lanes."""

_SPACING = 0.5  # m between the points of an arc; `path_of` recovers the arc for any spacing

_position, _heading_at = for_python(shapes.position), for_python(shapes.heading_at)


def road() -> RoadNetwork:
    """Return the simulator's twenty lanes as lanelets, y to the north."""
    numbers = range(geometry.N_LANES)
    # The simulator connects exits to approaches; no vehicle drives there.
    following = {
        lane: geometry.CONNECTED[lane, 1 : 4 if lane % 5 == 0 else 2].tolist()
        for lane in numbers
        if lane % 5 != EXIT
    }
    lanelets = {}
    for lane in numbers:
        record = geometry.LANES[lane]
        count = 2 if record["straight"] else int(np.ceil(record["length"] / _SPACING)) + 1
        along = np.linspace(0.0, float(record["length"]), count)
        centre = np.array([_position(record, metres) for metres in along])
        heading = np.array([_heading_at(record, metres) for metres in along])
        right = np.stack([-np.sin(heading), np.cos(heading)], axis=1) * (shapes.LANE_WIDTH / 2)
        flip = np.array([1.0, -1.0])
        leading = [before for before in numbers if lane in following.get(before, [])]
        lanelets[FIRST_LANELET + lane] = Lanelet(
            FIRST_LANELET + lane,
            (centre - right) * flip,
            (centre + right) * flip,
            tuple(FIRST_LANELET + after for after in following.get(lane, [])),
            tuple(FIRST_LANELET + before for before in leading),
            speed_limit=SPEED_LIMIT,
        )
    return RoadNetwork(lanelets)


def record(options: Options, policy: Policy, seed: int, name: str = "") -> Recording:
    """Run an episode with a policy of the ego and record every sub-step.

    By default the recording's name is derived from the seed.
    """
    batch = Batch(options, 1, traced=True)
    batch.reset([seed])
    count = int(batch.buffers.episodes[0]["vehicles"])
    frames, ending = [batch.buffers.vehicles[0, :count].copy()], Ending.NONE
    while ending == Ending.NONE:
        action, _ = policy.predict(batch.seen_by(policy))
        decisions = batch.step(action, auto_reset=False)
        count = int(batch.buffers.present[0, 0])
        frames += [moment[:count].copy() for moment in batch.buffers.trace[0]]
        ending = Ending(int(decisions.ending[0]))
    rows = np.concatenate(frames)
    frame = np.repeat(np.arange(len(frames)), [len(vehicles) for vehicles in frames])
    # In the order of the simulator's list, in which identities ascend.
    order = np.lexsort([frame, rows["identity"]])
    rows, frame = rows[order], frame[order]
    identity, track = np.unique(rows["identity"], return_inverse=True)
    numbers = track.astype(np.int32), frame.astype(np.int32)
    velocity = rows["speed"] * rows["along_x"], -rows["speed"] * rows["along_y"]
    states = *numbers, rows["x"].copy(), -rows["y"], -wrapped(rows["heading"]), *velocity
    length = np.full(len(identity), shapes.VEHICLE_LENGTH)
    width = np.full(len(identity), shapes.VEHICLE_WIDTH)
    kinds = np.full(len(identity), int(RoadUser.CAR), np.int8)
    step, name = 1 / options.simulation_frequency, name or f"simulated-{seed}"
    source = {"made_by": "socialiq simulator", "seed": seed, "options": repr(options)}
    users = identity.astype(np.int64) + 1, kinds, length, width
    return Recording(Tracks(*states, *users, step, name, source), road())


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
    dx, dy = tracks.x[after] - tracks.x[row], tracks.y[after] - tracks.y[row]
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
    low, high = np.full(group.max() + 1, 1 << 30), np.zeros(group.max() + 1, np.int64)
    np.minimum.at(low, group, track)
    np.maximum.at(high, group, track)
    repeats = low[group] != high[group]
    vehicles, repeating = len(np.unique(track)), len(np.unique(track[repeats]))
    if bdtrc(repeating - 1, vehicles, REPEATED) > CHANCE:
        return 0.0
    return float(repeats.mean())
