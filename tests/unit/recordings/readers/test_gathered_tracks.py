import numpy as np

from socialiq.physics import wrapped_heading
from socialiq_recordings.readers.tracks import differences, heading_of_motion, smoothed


def test_angles_that_lie_in_the_turn_keep_their_bits():
    inside = np.array([0.1, -3.1, np.pi, 1e-300])
    assert wrapped_heading(inside).tolist() == inside.tolist()
    np.testing.assert_allclose(
        wrapped_heading(np.array([4.0, -4.0])), [4 - 2 * np.pi, 2 * np.pi - 4]
    )
    assert wrapped_heading(np.array([-np.pi, 3 * np.pi])).tolist() == [np.pi, np.pi]


def test_a_quadratic_is_differentiated_without_error():
    t = np.arange(30) * 0.1
    vx, vy = smoothed(1 + 2 * t + 3 * t**2, -t, 0.1)
    np.testing.assert_allclose(vx, 2 + 6 * t, atol=1e-9)
    np.testing.assert_allclose(vy, -1.0, atol=1e-9)


def test_short_tracks_are_differenced():
    assert smoothed(np.array([3.0]), np.array([4.0]), 0.1)[0].tolist() == [0.0]
    np.testing.assert_allclose(smoothed(np.array([0.0, 1.0]), np.zeros(2), 0.1)[0], [10.0, 10.0])
    np.testing.assert_allclose(
        differences(np.array([0.0, 1.0, 4.0]), np.zeros(3), 1.0)[0], [1, 2, 3]
    )


def test_smoothing_takes_the_noise_out_of_a_steady_drive():
    random = np.random.default_rng(0)
    x = np.arange(200.0) + random.normal(0, 0.1, 200)  # 10 m/s at 10 Hz
    rough, _ = differences(x, np.zeros(200), 0.1)
    smooth, _ = smoothed(x, np.zeros(200), 0.1)
    assert np.std(smooth) < np.std(rough) / 4


def test_who_stands_keeps_the_heading_it_had_or_will_have():
    vx = np.array([0.0, 0.0, 1.0, 0.0, 0.1, 0.0])
    vy = np.array([0.0, 0.3, 0.0, 2.0, 0.0, 0.0])
    found = heading_of_motion(vx, vy)
    assert found is not None
    np.testing.assert_allclose(found, [0, 0, 0, np.pi / 2, np.pi / 2, np.pi / 2])
    assert heading_of_motion(np.full(3, 0.2), np.zeros(3)) is None
