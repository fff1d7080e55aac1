"""Ways by time, so that only vehicles that are seen near each other in time are paired."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from socialiq_recordings.conflicts.ways import Way


class InTime:
    """Ways of a recording, sorted by their first frames.

    A look-up costs as much as there are ways in its interval, where no vehicle is seen for much
    longer than the others.

    Args:
        ways: Ways by track.

    Attributes:
        ways: The same.
        longest: Frames of the way that is seen for longest.
    """

    def __init__(self, ways: Mapping[int, Way]) -> None:
        self.ways = ways
        every = list(ways.values())
        first = np.array([way.first for way in every], np.int64)
        self._order = np.argsort(first, kind="stable")
        self._first = first[self._order]
        self._every = every
        self.longest = max((len(way.along) for way in every), default=0)

    def seen(self, first: int | float, last: int | float) -> list[Way]:
        """Return the ways that are seen between two frames, both included, in their order.

        Args:
            first: Frame.
            last: Frame.
        """
        begin = np.searchsorted(self._first, first - self.longest, side="left")
        end = np.searchsorted(self._first, last, side="right")
        places = sorted(self._order[begin:end].tolist())
        return [self._every[place] for place in places if self._every[place].last >= first]

    def earlier(self, frame: int | float) -> Iterator[Way]:
        """Yield the ways that are seen first at a frame or before it, the latest first."""
        end = int(np.searchsorted(self._first, frame, side="right"))
        for place in self._order[:end][::-1].tolist():
            yield self._every[place]
