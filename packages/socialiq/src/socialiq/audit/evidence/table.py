"""Evidence as CSV files, and back, exactly: episodes of all drivers, decision losses by context."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from socialiq.audit.evidence.outcomes import COLUMNS, Evidence, Outcomes
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
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    drivers = evidence.drivers
    measured = (*MEASURED, *evidence.policy.measured)
    writer.writerow(_head(evidence.strata, [driver.name for driver in drivers], measured))
    columns: list[list[object]] = [
        list(range(evidence.episodes)),
        evidence.seeds.tolist(),
        *(labels.tolist() for labels in evidence.strata.values()),
    ]
    for driver in drivers:
        endings = [kind_of_ending(driver, episode) for episode in range(evidence.episodes)]
        rewards = [side.tolist() for side in driver.episodes.totals]
        columns += [*rewards, endings, driver.episodes.length.tolist()]
        columns += [driver.episodes[name].tolist() for name in driver.measured]
    writer.writerows(zip(*columns, strict=True))
    return text.getvalue()


def _head(strata: Mapping[str, object], drivers: list[str], measured: tuple[str, ...]) -> list[str]:
    columns = [f"{_no_formula(name)}.{column}" for name in drivers for column in measured]
    return [*_INDEX, *strata, *columns]


def _no_formula(name: str) -> str:
    """Return a name that spreadsheets don't interpret as a formula."""
    return f"'{name}" if name.startswith(tuple("=+-@\t\r'")) else name


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
    try:
        rows = csv.reader(io.StringIO(content.decode(), newline=""), strict=True)
        head = next(rows, [])
        measured = (*MEASURED, *beside)
        ours = f"{_no_formula(policy)}.{MEASURED[0]}"
        if ours not in head:
            raise ValueError(f"no column {ours}")
        first = head.index(ours)
        names_by_title = {_no_formula(name): name for name in (*attributes, *trivial)}
        titles = [title.removesuffix(f".{MEASURED[0]}") for title in head[first :: len(measured)]]
        names = [policy, *(names_by_title.pop(title) for title in titles[1:])]
        if names_by_title:
            raise ValueError(f"no columns of {next(iter(names_by_title.values()))}")
        if head != _head(dict.fromkeys(head[len(_INDEX) : first]), names, measured):
            raise ValueError("its columns are others")
        seeds, strata, drivers = _filled(
            rows, head[len(_INDEX) : first], first, names, measured, attributes
        )
    except (ValueError, KeyError, OverflowError, csv.Error) as error:
        raise UserError(f"it is not a table of episodes: {one_line(str(error))}") from error
    count = 1 + len(attributes)
    evidence = Evidence(
        scenario, seeds, drivers[0], tuple(drivers[1:count]), strata, tuple(drivers[count:])
    )
    if [driver.name for driver in evidence.trivial] != list(trivial):
        raise UserError("the trivial drivers don't follow the references")
    if write_table(evidence).encode() != content:
        raise UserError("it is not written as an audit writes it")
    return evidence


def _filled(
    rows: Iterator[list[str]],
    strata: list[str],
    first: int,
    names: list[str],
    measured: tuple[str, ...],
    attributes: Mapping[str, ReferenceAttributes],
) -> tuple[np.ndarray, dict[str, np.ndarray], list[Outcomes]]:
    """Return the seeds, the strata, and the outcomes of each driver."""
    width = first + len(measured) * len(names)
    seeds: list[int] = []
    labels: list[list[str]] = []
    episodes: list[tuple[np.ndarray, ...]] = []  # totals, kinds, lengths, what is beside, of all
    for row in rows:
        if len(row) != width:
            raise ValueError(f"row {len(seeds) + 1} has {len(row)} columns, not {width}")
        seeds.append(int(row[1]))
        labels.append(row[len(_INDEX) : first])
        cells = [row[first + column :: len(measured)] for column in range(len(measured))]
        pairs = np.array([list(map(float, cell)) for cell in cells[:2]]).T
        if not (np.abs(pairs) <= LARGEST_REWARD).all():
            raise ValueError(f"row {len(seeds)} has a reward that is no audit's")
        kinds = np.array([_KINDS[cell] for cell in cells[2]], np.int64)
        lengths = np.array(list(map(int, cells[3])), np.int64)
        columns = [np.array(list(map(float, cell))) for cell in cells[len(MEASURED) :]]
        for name, column in zip(measured[len(MEASURED) :], columns, strict=True):
            event = name in QUANTITIES and not QUANTITIES[name].unit
            if not (
                np.isin(column, (0.0, 1.0)) if event else np.abs(column) <= LARGEST_REWARD
            ).all():
                raise ValueError(f"row {len(seeds)} has a {name} that is no audit's")
        episodes.append((pairs, kinds, lengths, *columns))
    if not seeds:
        raise ValueError("no episodes")
    drivers = []
    values = list(zip(*episodes, strict=True))
    for driver, name in enumerate(names):
        totals, kind, length, *further = (
            np.array([row[driver] for row in rows]) for rows in values
        )
        ending, contact = kind.T.copy()
        fixed = attributes.get(name, ReferenceAttributes())
        core = zip(COLUMNS, (*totals.T, ending, contact, length), strict=True)
        beside = zip(measured[len(MEASURED) :], further, strict=True)
        drivers.append(Outcomes(name, Episodes([*core, *beside]), *fixed))
    columns = map(np.array, zip(*labels, strict=True))
    return np.array(seeds, np.int64), dict(zip(strata, columns, strict=True)), drivers


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
    episodes, contexts = losses.declared.shape
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*_FIRST, *(f"at_{angle:g}" for angle in candidates)])
    for episode in range(episodes):
        for context in range(contexts):
            index = (episode, context)
            row = [losses.decisions[index], losses.declared[index], *losses.by_angle[index]]
            writer.writerow([*index, *(number.item() for number in row)])
    return text.getvalue()


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
    try:
        rows = list(csv.reader(io.StringIO(content.decode(), newline=""), strict=True))[1:]
        decisions = np.array([int(row[2]) for row in rows], np.int64).reshape(shape)
        declared = np.array([float(row[3]) for row in rows]).reshape(shape)
        by_angle = np.array([list(map(float, row[4:])) for row in rows])
        losses = ContextLosses(declared, by_angle.reshape(*shape, len(candidates)), decisions)
    except (ValueError, IndexError, OverflowError, csv.Error) as error:
        raise UserError(f"it is not a table of contexts: {one_line(str(error))}") from error
    finite = all(np.isfinite(values).all() for values in losses)
    if not finite or write_contexts(losses, candidates).encode() != content:
        raise UserError("it is not written as an audit writes it")
    return losses
