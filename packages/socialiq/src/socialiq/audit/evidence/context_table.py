"""Decision losses of the policy by context as a CSV file, and back: every number reads exactly."""

from __future__ import annotations

import csv
import io

import numpy as np

from socialiq.errors import UserError
from socialiq.evaluation.context import ContextLosses
from socialiq.foreign import one_line

PATH = "contexts.csv"

_FIRST = ("episode", "context", "decisions", "declared")


def write_contexts(losses: ContextLosses, candidates: tuple[float, ...]) -> str:
    """Return a CSV with a row for each episode and context, numbered from 0.

    Args:
        losses: The losses.
        candidates: Angles of `by_angle`, in degrees.
    """
    episodes, contexts = losses.declared.shape
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*_FIRST, *(f"at_{angle:g}" for angle in candidates)])
    for episode in range(episodes):
        for context in range(contexts):
            place = (episode, context)
            row = [losses.decisions[place], losses.declared[place], *losses.by_angle[place]]
            writer.writerow([*place, *(one.item() for one in row)])
    return text.getvalue()


def read_contexts(
    content: bytes, episodes: int, contexts: int, candidates: tuple[float, ...]
) -> ContextLosses:
    """Read the result of `write_contexts`, exactly.

    Args:
        content: Content of the file.
        episodes: Number of episodes.
        contexts: Number of contexts of the rule.
        candidates: Angles in degrees.

    Raises:
        UserError: If it is not exactly as `write_contexts` writes it.
    """
    shape = (episodes, contexts)
    try:
        rows = list(csv.reader(io.StringIO(content.decode(), newline=""), strict=True))[1:]
        decisions = np.array([int(row[2]) for row in rows], np.int64).reshape(shape)
        declared = np.array([float(row[3]) for row in rows]).reshape(shape)
        by_angle = np.array([list(map(float, row[4:])) for row in rows])
        found = ContextLosses(declared, by_angle.reshape(*shape, len(candidates)), decisions)
    except (ValueError, IndexError, OverflowError, csv.Error) as error:
        raise UserError(f"it is not a table of contexts: {one_line(str(error))}") from error
    whole = all(np.isfinite(one).all() for one in found)
    if not whole or write_contexts(found, candidates).encode() != content:
        raise UserError("it is not written as an audit writes it")
    return found
