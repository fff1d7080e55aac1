"""Results of episodes: a table of named columns, and the one definition of each quantity.

A quantity of `DECISION` is computed at each decision and combined over the episode. One of
`EPISODE` follows from other columns. A quantity that a world does not report has no column.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Int64

from socialiq.evaluation.exact import Metrics
from socialiq.evaluation.simulate import Step
from socialiq.social.angle import exact_weights, score
from socialiq.statistics.intervals import normal_mean, wilson
from socialiq.types import Ending, RewardPair, Row
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.road_users import ROAD_USERS

STOPPED_BELOW = 0.5  # m/s


class Quantity(NamedTuple):
    """Definition of a quantity.

    Attributes:
        unit: Unit; "" for numbers, shares and events.
        of: Function of a decision (`Step`) that returns a value for each row, an empty array where
            the world does not report it, or several columns by the suffixes of their names. A
            quantity of `EPISODE` is a function of `Episodes`.
        over: Combination of the decisions of an episode: their sum, their number, their mean, or
            whether any is true.
    """

    unit: str
    of: Callable[[Any], Any]
    over: Literal["sum", "count", "mean", "any"] = "sum"


DECISION = {
    "r_env": Quantity("reward", lambda step: step.made.rewards.env),
    "r_social": Quantity("reward", lambda step: step.made.rewards.social),
    "classical_own": Quantity("reward", lambda step: step.made.classical.env),
    "classical_others": Quantity("reward", lambda step: step.made.classical.social),
    "length": Quantity("decisions", lambda step: np.ones(len(step.running)), "count"),
    "speed": Quantity("m/s", lambda step: step.made.speed, "mean"),
    "stopped": Quantity("", lambda step: step.made.speed < STOPPED_BELOW, "mean"),
    "off_road": Quantity("", lambda step: step.made.off_road, "any"),
    "neighbours_collided": Quantity("", lambda step: step.made.neighbours_collided, "count"),
    "signal": Quantity("", lambda step: step.made.signals),
    "active": Quantity(
        "decisions",
        lambda step: {name: column != 0 for name, column in step.made.signals.items()},
        "count",
    ),
}
"""Quantities of a decision on any road. `classical_own` and `classical_others` are the rewards of
the ego and of its neighbours in the mean (thesis A.1); `neighbours_collided` counts the other
vehicles that collided with each other; `signal_NAME` is the sum of a signal, unweighted, and
`active_NAME` the number of decisions in which it was not 0."""

EPISODE = {
    "arrival": Quantity("", lambda episodes: episodes.ending == Ending.ARRIVAL),
    "collision": Quantity("", lambda episodes: episodes.ending == Ending.COLLISION),
    "timeout": Quantity("", lambda episodes: episodes.ending == Ending.TIMEOUT),
    "at_fault": Quantity("", lambda episodes: episodes.collision & ~episodes.struck),
    "struck": Quantity(
        "", lambda episodes: episodes.collision & (episodes.contact == Contact.EGO_WAS_STRUCK)
    ),
    "r_caused": Quantity("reward", lambda episodes: episodes.r_social),
    "braking": Quantity("hard brakings", lambda episodes: episodes.signal_braking),
    "gap_below_1_s": Quantity("", lambda episodes: episodes.gap < 1.0),
    "gap_below_2_s": Quantity("", lambda episodes: episodes.gap < 2.0),
    **{
        name: Quantity("s", lambda episodes, kind=user.name: episodes[f"signal_{kind}_delay"])
        for user in ROAD_USERS
        for name in (user.delay, f"{user.name}_delay")
    },
    **{
        f"{user.name}_hit": Quantity(
            "", lambda episodes, kind=user.name: episodes[f"signal_{kind}_hit"] > 0
        )
        for user in ROAD_USERS
    },
}
"""Quantities of an episode that follow from columns. A collision is `at_fault` if the ego's motion
closed the gap, `struck` if the other's did; where fault is not known it is the ego's. `r_caused` is
r_social where effects are rewarded; delays of people are seconds that they would not lose without
the ego."""

LAST = ("ending", "contact")
"""Fields of a simulator's result of which the last value of an episode is a column."""


class Episodes(dict[str, np.ndarray]):
    """Table of episodes: columns by name with a row for each episode.

    Where several agents drive, columns are (episode, agent). `episodes[name]` and `episodes.name`
    return a column, or a quantity of `EPISODE`.
    """

    def __missing__(self, name: str) -> np.ndarray:
        return EPISODE[name].of(self)

    def __getattr__(self, name: str) -> np.ndarray:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"these episodes have no {name}") from None

    @property
    def totals(self) -> RewardPair:
        """Sums of r_env and r_social."""
        return RewardPair(self.r_env, self.r_social)

    def rows(self, chosen: Any) -> Episodes:
        """Return the chosen episodes: a slice, numbers, or a truth value for each."""
        return Episodes({name: column[chosen] for name, column in self.items()})

    def metrics(self) -> Metrics:
        """Return the metrics of thesis 5.4; speed and share stopped are means over episodes."""
        counts = np.bincount(self.ending, minlength=len(Ending))
        return Metrics.of(
            totals=RewardPair(self.r_env.mean(), self.r_social.mean()),
            endings=counts / len(self.ending),
            mean_speed=float(self.speed.mean()),
            stopped=float(self.stopped.mean()),
            length=float(self.length.mean()),
        )


def joined(blocks: Sequence[Episodes]) -> Episodes:
    """Return blocks of episodes as one table, in their order."""
    return Episodes({name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]})


def columns_of(
    steps: Iterable[Step], count: int, quantities: Mapping[str, Quantity] = DECISION
) -> Episodes:
    """Combine quantities over the decisions of each episode.

    Args:
        steps: Decisions of the episodes, as `simulate.simulate` yields them.
        count: Number of episodes.
        quantities: Quantities of a decision by name; means need `length`.

    Returns:
        A column for each quantity that the world reports, and the last values of `LAST`, which are
        0 where a simulator has none.
    """
    sums: dict[str, np.ndarray] = {}
    last: dict[str, np.ndarray] = {}
    combined: dict[str, str] = {}
    for step in steps:
        rows = step.episode[step.running]
        for name, quantity in quantities.items():
            value = quantity.of(step)
            columns = value if isinstance(value, Mapping) else {"": value}
            for suffix, of_rows in columns.items():
                column = "_".join(filter(None, (name, suffix)))
                values = np.atleast_1d(of_rows)
                if not len(values):
                    continue
                if column not in sums:
                    sums[column] = np.zeros((count, *values.shape[1:]))
                    combined[column] = quantity.over
                sums[column][rows] += values[step.running]
        for name in LAST:
            value = np.asarray(getattr(step.made, name, np.zeros(len(step.running), np.int64)))
            if name not in last:
                last[name] = np.zeros((count, *value.shape[1:]), np.int64)
            last[name][rows] = value[step.running]
    finish: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "sum": lambda column: column,
        "count": lambda column: column.astype(np.int64),
        "mean": lambda column: column / sums["length"],
        "any": lambda column: column > 0,
    }
    return Episodes(last | {name: finish[combined[name]](column) for name, column in sums.items()})


def summary(episodes: Episodes, names: Iterable[str]) -> Row:
    """Return quantities with 95 % intervals.

    Args:
        episodes: The episodes.
        names: Names of columns or quantities.

    Returns:
        For an event its share (Wilson), for numbers their mean (normal), with `_low` and `_high`.
    """
    row: Row = {}
    for name in names:
        column = episodes[name]
        row |= share(name, column) if column.dtype == bool else normal_mean(name, column)
    return row


def compared(totals: Sequence[RewardPair], angle: float) -> list[Row]:
    """Return the score of each policy at an angle, and by how much the best one exceeds it.

    Args:
        totals: Sums of both rewards in each episode, the same episodes of each policy.
        angle: Social angle in degrees.

    Returns:
        For each policy `score`, the mean of cos α R_env + sin α R_social at `score_angle`; of
        several also `below_best`, the mean of the paired differences, and `best`, whether it is
        the best one. Numbers have 95 % intervals (normal), `_low` and `_high`.
    """
    scores = [score(exact_weights(angle), pair) for pair in totals]
    rows: list[Row] = [
        {"score_angle": angle} | normal_mean("score", of_policy) for of_policy in scores
    ]
    if len(rows) == 1:
        return rows
    best = int(np.argmax([row["score"] for row in rows]))
    return [
        row | normal_mean("below_best", scores[best] - of_policy) | {"best": policy == best}
        for policy, (row, of_policy) in enumerate(zip(rows, scores, strict=True))
    ]


def by_episode(
    episodes: Episodes, names: Iterable[str], seeds: Int64[np.ndarray, " episode"], label: Row
) -> list[Row]:
    """Return a row for each episode.

    Args:
        episodes: The episodes.
        names: Names of columns or quantities.
        seeds: Seed of each episode.
        label: What all rows begin with.

    Returns:
        Rows with the label, `seed` and the quantities.
    """
    columns = {"seed": seeds} | {name: episodes[name] for name in names}
    rows = zip(*columns.values(), strict=True)
    return [label | dict(zip(columns, row, strict=True)) for row in rows]


def share(name: str, happened: Bool[np.ndarray, " trial"], confidence: float = 0.95) -> Row:
    """Return the share of trials with an event and the ends of its Wilson interval.

    Args:
        name: Name of the share.
        happened: Whether the event happened in each trial.
        confidence: Probability of the interval.

    Returns:
        name, name_low and name_high, which are None without trials.
    """
    trials = len(happened)
    ends = wilson(int(happened.sum()), trials, confidence) if trials else (None, None, None)
    return dict(zip((name, f"{name}_low", f"{name}_high"), ends, strict=True))
