"""Episodes of recorded drivers, made up."""

import numpy as np
import pytest

from socialiq.recordings.annotate import Driven
from socialiq.recordings.ego_swap import Swapped, demonstrations
from socialiq.recordings.reading import Reading
from socialiq.types import Ending


@pytest.fixture(scope="session")
def drive():
    """One vehicle's episode of given reward pairs."""

    def make(pair, ending=Ending.TIMEOUT, contact=0, seed=0, features=70):
        pair = np.array(pair, np.float64)
        count, rng = len(pair), np.random.default_rng(seed)
        endings = np.zeros(count, np.int8)
        endings[-1] = ending
        return Driven(
            track=0,
            junction=0,
            frame=np.arange(count + 1) * 10,
            observation=rng.uniform(-1, 1, (count + 1, features)).astype(np.float32),
            action=rng.integers(0, 3, count).astype(np.int32),
            residual=np.full(count, 0.5),
            speed=np.full(count + 1, 5.0),
            pair=pair,
            signals=np.zeros((count, 9)),
            ending=endings,
            jump=0.0,
            contact=contact,
        )

    return make


@pytest.fixture(scope="session")
def swapped():
    """One recording of given episodes."""

    def make(name, episodes, moments=None, reading=None):
        return Swapped(
            recording=name,
            n_tracks=len(episodes) + 2,
            seconds=10.0,
            source={"file": f"{name}.csv"},
            identity=tuple(range(100, 100 + len(episodes))),
            episodes=tuple(episodes),
            left_out={"never at a conflict area": 2},
            conflicts=4,
            moments=frozenset(moments or {f"{name}{n}".encode() for n in range(len(episodes))}),
            reading=reading or Reading(),
        )

    return make


@pytest.fixture
def human(drive, swapped):
    """Three recordings of two, one and two drivers."""
    one = [drive([[0.1, 0.2], [0.3, 0.0]], seed=1), drive([[0.5, -1.0]], Ending.ARRIVAL, seed=2)]
    two = [drive([[-2.0, -5.0]], Ending.COLLISION, 1, seed=3)]
    three = [drive([[0.2, 0.2]] * 3, seed=4), drive([[0.0, 0.4]] * 4, seed=5)]
    sites = ("USA_Lanker-1_1_T-1", "USA_Lanker-1_3_T-1", "monday")
    return [swapped(name, part) for name, part in zip(sites, (one, two, three), strict=True)]


@pytest.fixture
def human_table(human):
    return demonstrations(human)
