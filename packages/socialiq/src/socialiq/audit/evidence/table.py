"""Evidence as CSV files, and back, exactly: episodes of all drivers, decision losses by context."""

from __future__ import annotations

import contextlib
import csv
import io
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.profile.fields import QUANTITIES
from socialiq.errors import UserError
from socialiq.evaluation.context import ContextLosses
from socialiq.evaluation.measures import Episodes
from socialiq.foreign import one_line
from socialiq.types import Ending, RewardPair
from socialiq.worlds.highway.options import Contact

MEASURED = ("r_env", "r_social", "ending", "decisions")  # columns of each driver

_INDEX = ("episode", "seed")
LARGEST_REWARD = 1e12  # largest sum of rewards of an episode, either sign, that a table may hold

_COLLISIONS = {
    Contact.NONE: "collision",  # of an environment, where fault is not known
    Contact.EGO_STRUCK: "drove into another",
    Contact.EGO_WAS_STRUCK: "struck by another",
}

_ENDINGS: dict[tuple[int, int], str] = {
    (int(ending), int(contact)): (text if ending is Ending.COLLISION else ending.name.lower())
    for ending, (contact, text) in itertools.product(Ending, _COLLISIONS.items())
}
_KINDS: dict[str, tuple[int, int]] = {text: kind for kind, text in reversed(_ENDINGS.items())}


def kind_of_ending(driver: Outcomes, episode: int) -> str:
    """Return the ending of an episode in one word or a few.

    Args:
        driver: The driver.
        episode: Row of the episode, from 0.
    """
    episodes = driver.episodes
    return _ENDINGS[int(episodes.ending[episode]), int(episodes.contact[episode])]


class ReferenceAttributes(NamedTuple):
    """Attributes of a reference that are the same in every episode: see `Outcomes`."""

    angles: tuple[float, ...] = ()
    expected: RewardPair | None = None


def write_table(evidence: Evidence) -> str:
    """Return a CSV with seed, strata, and `MEASURED` of each driver."""
    drivers = evidence.drivers
    columns: list[Sequence[object]] = [range(evidence.episodes), evidence.seeds.tolist()]
    columns += [labels.tolist() for labels in evidence.strata.values()]
    for driver in drivers:
        columns += [side.tolist() for side in driver.episodes.totals]
        columns.append([kind_of_ending(driver, episode) for episode in range(evidence.episodes)])
        columns += [driver.episodes[name].tolist() for name in ("length", *driver.measured)]
    measured = (*MEASURED, *evidence.policy.measured)
    head = _head(evidence.strata, [driver.name for driver in drivers], measured)
    return _text([head, *zip(*columns, strict=True)])


def _head(strata: Iterable[str], drivers: list[str], measured: tuple[str, ...]) -> list[str]:
    columns = [f"{_no_formula(name)}.{column}" for name in drivers for column in measured]
    return [*_INDEX, *strata, *columns]


def _no_formula(name: str) -> str:
    """Return a name that spreadsheets don't interpret as a formula."""
    return f"'{name}" if name.startswith(tuple("=+-@\t\r'")) else name


def _text(rows: Iterable[Iterable[object]]) -> str:
    """Return rows as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


@contextlib.contextmanager
def _rows_of(content: bytes, what: str) -> Iterator[Iterator[list[str]]]:
    """Open the rows of a CSV file; `UserError` if the block doesn't find a table in them."""
    try:
        yield csv.reader(io.StringIO(content.decode(), newline=""), strict=True)
    except (ValueError, LookupError, OverflowError, csv.Error) as error:
        raise UserError(f"it is not a table of {what}: {one_line(str(error))}") from error


_NOT_WRITTEN = "it is not written as an audit writes it"


def read_table(
    content: bytes,
    scenario: str,
    policy: str,
    attributes: Mapping[str, ReferenceAttributes],
    trivial: Sequence[str] = (),
    beside: Sequence[str] = (),
) -> Evidence:
    """Read the result of `write_table`, exactly.

    The contact of an episode without a collision is read as none; no result depends on it.

    Args:
        content: Bytes of the CSV file.
        scenario: The world's description.
        policy: Name of the policy, whose columns come first.
        attributes: Attributes of each reference by its name; the table has each of them once, in
            any order.
        trivial: Names of the trivial drivers, which follow the references in this order.
        beside: Names of the further columns of each driver (`Outcomes`).

    Raises:
        UserError: If it is not exactly as `write_table` writes it.
    """
    with _rows_of(content, "episodes") as rows:
        head = next(rows, [])
        measured = (*MEASURED, *beside)
        ours = f"{_no_formula(policy)}.{MEASURED[0]}"
        if ours not in head:
            raise ValueError(f"no column {ours}")
        first = head.index(ours)
        strata = head[len(_INDEX) : first]
        names_by_title = {_no_formula(name): name for name in (*attributes, *trivial)}
        titles = [title.removesuffix(f".{MEASURED[0]}") for title in head[first :: len(measured)]]
        names = [policy, *(names_by_title.pop(title) for title in titles[1:])]
        if names_by_title:
            raise ValueError(f"no columns of {next(iter(names_by_title.values()))}")
        if head != _head(dict.fromkeys(strata), names, measured):
            raise ValueError("its columns are others")
        seeds, labels, values = _numbers(rows, first, len(names), measured)
    drivers = []
    for name, columns in zip(names, values, strict=True):
        totals = dict(zip(("r_env", "r_social"), columns, strict=False))
        ending, contact = np.array(list(_KINDS.values()))[columns[2].astype(np.int64)].T
        integers = {"ending": ending, "contact": contact, "length": columns[3].astype(np.int64)}
        further = dict(zip(beside, columns[len(MEASURED) :], strict=True))
        fixed = attributes.get(name, ReferenceAttributes())
        drivers.append(Outcomes(name, Episodes(totals | integers | further), *fixed))
    count = 1 + len(attributes)
    evidence = Evidence(
        scenario=scenario,
        seeds=seeds,
        policy=drivers[0],
        references=tuple(drivers[1:count]),
        strata=dict(zip(strata, labels.T, strict=True)),
        trivial=tuple(drivers[count:]),
    )
    if [driver.name for driver in evidence.trivial] != list(trivial):
        raise UserError("the trivial drivers don't follow the references")
    if write_table(evidence).encode() != content:
        raise UserError(_NOT_WRITTEN)
    return evidence


_PLACES = {text: row for row, text in enumerate(_KINDS)}
_READ: dict[str, Callable[[str], float]] = {"ending": _PLACES.__getitem__, "decisions": int}
"""Functions that read a cell, an ending as its place in `_KINDS`; else it has a number."""


def _numbers(
    rows: Iterator[list[str]], first: int, drivers: int, measured: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray, Float[np.ndarray, "driver column episode"]]:
    """Return the seeds, the labels of each episode, and the numbers of each driver (`_READ`)."""
    readers = [_READ.get(column, float) for column in measured] * drivers
    width = first + len(readers)
    seeds: list[int] = []
    labels: list[list[str]] = []
    numbers: list[np.ndarray] = []
    for row in rows:
        if len(row) != width:
            raise ValueError(f"row {len(seeds) + 1} has {len(row)} columns, not {width}")
        seeds.append(int(row[1]))
        labels.append(row[len(_INDEX) : first])
        cells = zip(readers, row[first:], strict=True)
        numbers.append(np.array([read(cell) for read, cell in cells], np.float64))
    if not seeds:
        raise ValueError("no episodes")
    values = np.array(numbers).reshape(len(seeds), drivers, len(measured)).transpose(1, 2, 0)
    for name, column in zip(measured, values.swapaxes(0, 1), strict=True):
        event = name in QUANTITIES and not QUANTITIES[name].unit
        fine = np.isin(column, (0.0, 1.0)) if event else np.abs(column) <= LARGEST_REWARD
        if not fine.all():
            what = "reward" if name in MEASURED else name
            row = int(fine.all(axis=0).argmin()) + 1
            raise ValueError(f"row {row} has a {what} that is no audit's")
    return np.array(seeds, np.int64), np.array(labels), values


CONTEXTS = "contexts.csv"
_FIRST = ("episode", "context", "decisions", "declared")


def write_contexts(losses: ContextLosses, candidates: tuple[float, ...]) -> str:
    """Return a CSV with a row for each episode and context, and the loss at candidate angles.

    Args:
        losses: Decision losses of the policy by episode and context.
        candidates: Candidate angles in degrees, in the order of `losses.by_angle`.

    Returns:
        The text of the file, with the number of decisions and the loss at the declared angle too.
    """
    rows: list[list[object]] = [[*_FIRST, *(f"at_{angle:g}" for angle in candidates)]]
    for index in np.ndindex(losses.declared.shape):
        row = [losses.decisions[index], losses.declared[index], *losses.by_angle[index]]
        rows.append([*index, *(number.item() for number in row)])
    return _text(rows)


def read_contexts(
    content: bytes, episodes: int, contexts: int, candidates: tuple[float, ...]
) -> ContextLosses:
    """Read the result of `write_contexts`, exactly.

    Args:
        content: Bytes of the CSV file.
        episodes: Number of episodes.
        contexts: Number of contexts of the rule.
        candidates: Candidate angles in degrees.

    Raises:
        UserError: If it is not exactly as `write_contexts` writes it.
    """
    shape = (episodes, contexts)
    with _rows_of(content, "contexts") as lines:
        rows = list(lines)[1:]
        decisions = np.array([int(row[2]) for row in rows], np.int64).reshape(shape)
        declared = np.array([float(row[3]) for row in rows]).reshape(shape)
        by_angle = np.array([list(map(float, row[4:])) for row in rows])
        losses = ContextLosses(declared, by_angle.reshape(*shape, len(candidates)), decisions)
    finite = all(np.isfinite(values).all() for values in losses)
    if not finite or write_contexts(losses, candidates).encode() != content:
        raise UserError(_NOT_WRITTEN)
    return losses
