"""A hand-made recording: two lanes that cross in the origin, and a vehicle on each."""

import numpy as np

from socialiq_recordings import files
from socialiq_recordings.recording import Recording, Tracks
from socialiq_recordings.road.network import Lanelet, RoadNetwork

DT = 0.1
EDGE = 2.85  # m from the origin to a vehicle's middle when its bumper is at the conflict area


def lane(identity, start, end):
    ends = np.array([start, end], np.float64)
    along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    left = np.array([-along[1], along[0]]) * 1.75
    return Lanelet(identity, ends + left, ends - left)


def crossing(first_frame=7, road=None):
    """Return 12 s of a vehicle to the east at 8 m/s, and one to the north that comes 2 s later."""
    frames = np.arange(120)
    east, north = -40 + 8 * DT * frames, -56 + 8 * DT * frames
    n = len(frames)

    def column(one, other):
        return np.concatenate([one, other]).astype(np.float64)

    tracks = Tracks(
        track=np.repeat(np.arange(2), n).astype(np.int32),
        frame=np.tile(frames + first_frame, 2).astype(np.int32),
        x=column(east, np.zeros(n)),
        y=column(np.zeros(n), north),
        heading=column(np.zeros(n), np.full(n, np.pi / 2)),
        vx=column(np.full(n, 8.0), np.zeros(n)),
        vy=column(np.zeros(n), np.full(n, 8.0)),
        identity=np.array([31, 32]),
        road_user=np.zeros(2, np.int8),
        length=np.full(2, 4.0),
        width=np.full(2, 2.0),
        dt=DT,
        recording="hand-made",
        source={},
    )
    lanes = {1: lane(1, (-80, 0), (120, 0)), 2: lane(2, (0, -80), (0, 120))}
    return Recording(tracks, RoadNetwork(lanes) if road is None else road)


def saved(folder, recording=None):
    files.save(folder / "made.safetensors", recording or crossing())
    return folder / "made.safetensors"
