import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from socialiq.worlds.highway.options import ANNOTATE, VEHICLE, Buffers, Contact, settings_of
from socialiq.worlds.highway.scene_batch import Batch
from socialiq.worlds.intersection.options import Options, buffers_of
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.world import Decisions


def car(x: float, y: float, degrees: float, speed: float, **fields: Any) -> np.ndarray:
    """A vehicle's record; 0 degrees is east, -90 north."""
    record = np.zeros((), VEHICLE)
    heading = math.radians(degrees)
    place = {"x": x, "y": y, "heading": heading, "speed": speed}
    place["route"] = 5 * fields.get("origin", 0)
    for name, value in {**place, "desired_speed": math.inf, "agent": -1, **fields}.items():
        record[name] = value
    record["along_x"], record["along_y"] = (
        round(math.cos(heading), 15),
        round(math.sin(heading), 15),
    )
    return record


@pytest.fixture(name="car", scope="session")
def car_fixture():
    return car


def annotated(
    before: Sequence[np.ndarray],
    after: Sequence[np.ndarray],
    options: Options | None = None,
    ego: int = 0,
    start: float = 60.0,
    time: float = 3.0,
    contact: Contact = Contact.NONE,
    touched: int = -1,
) -> Buffers:
    """Annotate a decision between two lists of cars with the core; one row of buffers."""
    from socialiq.worlds.highway.core import step
    from socialiq.worlds.intersection.core.geometry import ROAD

    options = options or Options()
    made = buffers_of(options, 1)
    for column, cars in ((made.before, before), (made.after, after)):
        for slot, one in enumerate(cars):
            column[0, slot] = one
            column[0, slot]["identity"] = slot
    made.present[0] = len(after), ego
    made.episodes["start"], made.episodes["time"] = start, time
    made.episodes["contact"], made.episodes["touched"] = contact, touched
    command, nothing = np.array([ANNOTATE], np.int8), np.zeros(1, np.int64)
    unseeded = nothing.astype(np.uint64), nothing.astype(bool)
    step.run(made, command, *unseeded, nothing, settings_of(options), ROAD, 0, 1)
    return made


@pytest.fixture(name="annotated", scope="session")
def annotated_fixture():
    return annotated


def actions_of(size: int, seed: int) -> Iterator[np.ndarray]:
    """Yield random actions of a batch without end."""
    rng = np.random.default_rng(seed)
    return (rng.integers(3, size=size) for _ in itertools.count())


@pytest.fixture(name="actions_of", scope="session")
def actions_fixture():
    return actions_of


def drive(
    options: Options, size: int, steps: int, seed: int = 0, traced: bool = False
) -> Iterator[tuple[Batch, Decisions]]:
    """Random decisions with automatic resets; the same batch is yielded after each."""
    batch = Intersection(options).batch(size, traced=traced)
    batch.reset(seed)
    for action in itertools.islice(actions_of(size, seed), steps):
        yield batch, batch.step(action)


@pytest.fixture(name="drive", scope="session")
def drive_fixture():
    return drive
