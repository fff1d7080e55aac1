"""A simulated recording is named so by its header, its missing noise or its repetition."""

import dataclasses

import numpy as np
import pytest

from socialiq_recordings.signs_of_simulation import signs_of_simulation


def noisy(straight, speeds, seed=0, **fields):
    tracks = straight(speeds, frames=60, **fields)
    rng = np.random.default_rng(seed)
    x, y, vx = (
        getattr(tracks, name) + rng.normal(0.0, 0.03, tracks.n_states) for name in ("x", "y", "vx")
    )
    return dataclasses.replace(tracks, x=x, y=y, vx=vx)


@pytest.mark.parametrize(
    ("source", "sign"),
    [
        ({"source": "SUMO Traffic Simulator"}, "its source names 'sumo'"),
        ({"tags": "urban simulated"}, "its tags names"),
        ({"source": "recorded with CARLA"}, "names 'carla'"),
        ({"source": "Next Generation Simulation (NGSIM)"}, ""),
        ({"source": "inD"}, ""),
    ],
)
def test_headers(straight, source, sign):
    signs = signs_of_simulation(noisy(straight, [8.0, 9.0], source=source))
    assert (sign in signs[0]) if sign else signs == ()


def test_missing_noise(straight):
    tracks = straight([8.0, 9.0], frames=60)
    assert "no noise" in signs_of_simulation(tracks)[0]
    assert signs_of_simulation(noisy(straight, [8.0, 9.0])) == ()


def test_exact_repetition(straight):
    tracks = noisy(straight, [8.0, 9.0])
    pattern = 8.0 + np.sin(np.arange(60) * 0.3)
    again = dataclasses.replace(tracks, vx=np.concatenate([pattern, np.roll(pattern, 7)]))
    assert "repeated exactly" in signs_of_simulation(again)[0]


def test_one_pair_of_equal_tracks_in_a_short_clip_is_no_simulation(straight):
    # 1.6 s at 10 Hz, as clips of NGSIM are: each vehicle has few seconds, which overlap.
    tracks, rng = straight([8.0] * 20, frames=17), np.random.default_rng(0)
    swings = 8.0 + np.sin(np.arange(17) * 0.4 + rng.uniform(0, 6, 20)[:, None])
    x, y = (place + rng.normal(0.0, 0.03, tracks.n_states) for place in (tracks.x, tracks.y))
    swings[1] = swings[0]
    pair = dataclasses.replace(tracks, x=x, y=y, vx=swings.ravel())
    assert signs_of_simulation(pair) == ()
    every = dataclasses.replace(pair, vx=np.tile(swings[0], 20))
    assert "repeated exactly" in signs_of_simulation(every)[0]
