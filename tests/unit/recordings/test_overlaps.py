"""Overlaps of tracks, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from socialiq_recordings.plausible import overlaps


def test_the_depth_of_an_overlap_of_tracks(straight):
    tracks = straight([8.0, 8.0], frames=2, apart=1.5)
    pairs = overlaps(tracks)
    assert pairs.first.tolist() == [0, 1] and pairs.second.tolist() == [2, 3]
    assert pairs.depth == pytest.approx([0.3, 0.3])  # 1.8 m wide, 1.5 m apart
    assert not len(overlaps(straight([8.0, 8.0], frames=2, apart=2.0)).depth)


def test_depths_of_overlaps_are_those_of_paper(straight):
    # Side by side: 1.8 m wide, 1.5 m apart: 0.3 m. Only at common frames.
    found = overlaps(straight([0.0, 0.0], frames=2, apart=1.5))
    np.testing.assert_allclose(found.depth, [0.3, 0.3])
    pairs = {frozenset(pair) for pair in zip(*(one.tolist() for one in found[:2]), strict=True)}
    assert pairs == {frozenset((0, 2)), frozenset((1, 3))}
    # One turned by 45° and 2.5 m to the left: its corner reaches (4.5 + 1.8) / 2 · sin 45° = 2.227,
    # so 0.9 + 2.227 - 2.5 = 0.627 m along y; its own long axis: 2.25 + 2.227 - 1.768 = 2.710 m.
    turned = straight([0.0, 0.0], frames=1, apart=2.5)
    turned = replace(turned, heading=np.array([0.0, np.pi / 4]))
    np.testing.assert_allclose(overlaps(turned).depth, [0.9 + 6.3 / 2 * np.sqrt(0.5) - 2.5])
    # 3.2 m to the left the circles meet, the rectangles don't.
    assert len(overlaps(replace(turned, y=np.array([0.0, 3.2]))).depth) == 0


def test_overlaps_do_not_depend_on_blocks_of_frames(straight, monkeypatch):
    tracks = straight([1.0, 2.0, 3.0, 4.0], frames=30, apart=1.0)
    whole = overlaps(tracks)
    monkeypatch.setattr("socialiq_recordings.plausible._BLOCK", 10)
    parts = overlaps(tracks)
    assert len(whole.depth) == len(parts.depth) > 0
    ours, theirs = (
        {(frozenset((a, b)), round(depth, 9)) for a, b, depth in zip(*found, strict=True)}
        for found in (whole, parts)
    )
    assert ours == theirs
