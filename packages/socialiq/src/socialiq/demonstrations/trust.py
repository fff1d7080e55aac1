"""Consistency of labels where no world can recompute them: is each reward what others' rows say?

Honest labels are one function of the transition and its ending, whatever the driver. It is learned
by boosted trees from episodes other than the judged one (Friedman 2001, least absolute deviation):
every row votes with the sign of its residual, so a minority of large labels can't lead. An
episode's score is its largest residual. Labels of events that none but a forger's episodes have
are beyond any such check, unless trusted episodes of one's own are the reference.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import Ending

FOLDS = 5
BINS = 16
LEAST = 5  # rows on either side of a split
TREES = 60
DEPTH = 3
RATE = 0.3
FALSE_ALARMS = 0.05
"""Share of honest episodes that may be flagged."""
FACTOR = 3.0
PART = 0.6
"""Without a reference the limit is so many times the score of so large a part of the episodes: most
must be honest. Chosen in simulation for `FALSE_ALARMS` (docs/trust.md)."""


class Consistency(NamedTuple):
    """Outcome for a table.

    Attributes:
        residual: Largest residual of each episode's r_env and r_social.
        limit: Of either label; beyond it an episode is flagged.
        flagged: Episodes beyond a limit.
        expected: r_env and r_social of each row by all other episodes.
    """

    residual: Float[np.ndarray, "episode 2"]
    limit: Float[np.ndarray, " 2"]
    flagged: Bool[np.ndarray, " episode"]
    expected: Float[np.ndarray, "row 2"]


def consistency(data: Demonstrations, reference: Demonstrations | None = None) -> Consistency:
    """Judge every episode's labels by those of other episodes, or of a trusted reference.

    With a reference the limits are its own scores' quantiles, so that at most `FALSE_ALARMS` of
    honest episodes like those of the reference are flagged, however many others are forged.

    Raises:
        UserError: If there is one episode only, or the tables come from different worlds.
    """
    base = data if reference is None else reference
    folds = min(FOLDS, base.n_episodes)
    if folds < 2:
        raise UserError("labels are judged by those of other episodes: pass two or more")
    shapes = {(t.n_features, t.n_actions, t.action_size) for t in (data, base)}
    if len(shapes) > 1:
        raise UserError("the reference has other observations or actions: record the same world")
    tables = [base] if reference is None else [base, data]
    codes = np.concatenate([_codes(table, base) for table in tables])
    count = base.n_transitions
    fold = np.full(len(codes), -1)  # of rows that are judged only
    fold[:count] = (np.random.default_rng(0).permutation(base.n_episodes) % folds)[base.episode]
    expected = np.zeros((len(codes), 2))
    for number, label in enumerate(base.rewards):
        padded = np.pad(label, (0, len(codes) - count))
        for out in np.unique(fold):
            value = _boosted(codes, padded, (fold >= 0) & (fold != out))
            expected[fold == out, number] = value[fold == out]
    judged = of_base = _largest_gaps(base, expected[:count])
    limit = FACTOR * np.quantile(of_base, PART, axis=0)
    if reference is not None:  # both labels share the false alarms
        judged = _largest_gaps(data, expected[count:])
        limit = np.quantile(of_base, 1.0 - FALSE_ALARMS / 2, axis=0, method="higher")
    limit = limit + 1e-6 * np.array([1.0 + np.abs(label).max() for label in base.rewards])
    flagged = np.any(judged > limit, axis=1)
    return Consistency(
        judged, limit, np.asarray(flagged), expected[len(codes) - data.n_transitions :]
    )


def _largest_gaps(
    data: Demonstrations, expected: Float[np.ndarray, "row 2"]
) -> Float[np.ndarray, "episode 2"]:
    """Return the largest difference of each episode's labels from the expected ones."""
    gaps = np.abs(np.stack(data.rewards, axis=1) - expected)
    return np.maximum.reduceat(gaps, data.episode_starts)


def _codes(data: Demonstrations, base: Demonstrations) -> Int[np.ndarray, "row feature"]:
    """Return the bin of each feature of a transition, at most `BINS`, by another table's values."""
    columns = []
    for values, of_base in zip(_features(data).T, _features(base).T, strict=True):
        distinct = np.unique(of_base)
        edges = (distinct[1:] + distinct[:-1]) / 2
        if len(distinct) > BINS:
            edges = np.unique(np.quantile(of_base, np.arange(1, BINS) / BINS))
        columns.append(np.searchsorted(edges, values))
    return np.stack(columns, axis=1)


def _features(data: Demonstrations) -> Float[np.ndarray, "row feature"]:
    """Return observations before, after, their change, the action and the kind of ending."""
    action = data.action.reshape(data.n_transitions, -1)
    ending = np.eye(len(Ending))[data.ending]
    before = data.observation
    after = data.next_observation
    return np.column_stack([before, after, after - before, action, ending])


def _boosted(
    codes: Int[np.ndarray, "row feature"],
    label: Float[np.ndarray, " row"],
    base: Bool[np.ndarray, " row"],
) -> Float[np.ndarray, " row"]:
    """Return the label of every row by trees that were fitted to the given rows alone."""
    value = np.full(len(label), np.median(label[base]))
    for _ in range(TREES):
        sign = np.sign(label[base] - value[base])
        leaf = np.zeros(len(label), np.int64)
        for level in range(DEPTH):
            feature, edge = _splits(codes[base], leaf[base], sign, 2**level)
            there = codes[np.arange(len(leaf)), feature[leaf]] > edge[leaf]
            leaf = 2 * leaf + there
        gap = (label - value)[base]
        medians = [
            np.median(gap[rows]) if (rows := leaf[base] == number).any() else 0.0
            for number in range(2**DEPTH)
        ]
        value = value + RATE * np.array(medians)[leaf]
    return value


def _splits(
    codes: np.ndarray, leaf: np.ndarray, sign: np.ndarray, leaves: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the feature and bin at which each leaf's votes differ most."""
    rows, features = codes.shape
    cell = ((leaf[:, None] * features + np.arange(features)) * BINS + codes).ravel()
    shape = leaves, features, BINS
    votes = np.bincount(cell, np.repeat(sign, features), leaves * features * BINS)
    count = np.bincount(cell, minlength=leaves * features * BINS)
    below, size = (array.reshape(shape).cumsum(axis=2) for array in (votes, count))
    total = below[:, :, -1:]
    rest = size[:, :, -1:] - size
    gain = below**2 / np.maximum(size, 1) + (total - below) ** 2 / np.maximum(rest, 1)
    gain = np.where((size >= LEAST) & (rest >= LEAST), gain, -1.0).reshape(leaves, -1)
    best = gain.argmax(axis=1)
    edge = np.where(gain.max(axis=1) < 0, rows, best % BINS)  # nothing lies beyond it: no split
    return best // BINS, edge
