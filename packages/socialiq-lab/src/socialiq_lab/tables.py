"""Operations on rows that studies share: groups, means, nested summaries, adjusted tests."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from socialiq.errors import one_of
from socialiq.results_folder import as_text, where
from socialiq.statistics.comparisons import holm, paired_difference
from socialiq.statistics.intervals import normal_mean
from socialiq.types import Row


class NamedRow(dict[str, Any]):
    """A row that refuses a column which it hasn't, with the list of those it has."""

    def __missing__(self, name: str) -> Any:
        one_of("column", name, tuple(self))

    def __or__(self, columns: Any) -> Any:
        return NamedRow({**self, **columns})


def checked_rows(tables: Mapping[str, Sequence[Row]]) -> dict[str, list[Row]]:
    """Return tables whose rows refuse unknown columns by name."""
    return {name: [NamedRow(row) for row in rows] for name, rows in tables.items()}


def groups(rows: Sequence[Row], *keys: str) -> dict[tuple, list[Row]]:
    """Return the rows by their values of some columns, in order of first appearance."""
    result: dict[tuple, list[Row]] = {}
    for row in rows:
        result.setdefault(tuple(row[key] for key in keys), []).append(row)
    return result


def labelled(rows: Sequence[Row], *keys: str) -> Iterator[tuple[Row, list[Row]]]:
    """Yield the values of some columns, as the beginning of a row, and the rows that have them."""
    for values, group in groups(rows, *keys).items():
        yield dict(zip(keys, values, strict=True)), group


def over_seeds(name: str, runs: Sequence[np.ndarray]) -> Row:
    """Return a mean over training seeds and episodes.

    Args:
        name: Name of the mean.
        runs: Values of the same episodes, (episode,), for each training seed.

    Returns:
        The columns of `normal_mean` over episodes, and the least and the largest mean of a seed,
        name_least and name_largest.
    """
    means = [float(run.mean()) for run in runs]
    row = normal_mean(name, np.mean(runs, axis=0))
    return row | {f"{name}_least": min(means), f"{name}_largest": max(means)}


def matching(rows: Sequence[Row], **columns: Any) -> list[Row]:
    """Return the rows that have these values."""
    return [row for row in rows if all(row[key] == value for key, value in columns.items())]


def derived(specification: Mapping[str, Any], tables: Mapping[str, list[Row]], ground: Any) -> Any:
    """Return the rows of a `[[table]]` of a STUDY.toml, which follow from another table.

    Its operations are taken in this order: `from`, `where`, `regret_at` (an angle in degrees), and
    one of `mean` (means of numeric columns by these columns), `spread` (mean, least and largest of
    every column by these columns), `paired` (tests of a difference over seeds, see `paired_table`)
    and `pool` (exact metrics, means over seeds by these columns).

    Args:
        specification: The `[[table]]`.
        tables: Tables so far, by name.
        ground: The world, for regrets; None if there are none.
    """
    rows = where(tables[specification["from"]], specification.get("where", {}))
    if "regret_at" in specification:
        angle = specification["regret_at"]
        rows = [row | {"regret": ground.optimum.regret(metrics_of(row), angle)} for row in rows]
    if "mean" in specification:
        keys = specification["mean"]
        return [label | numeric_means(group) for label, group in labelled(rows, *keys)]
    if "spread" in specification:
        keys = specification["spread"]
        return [label | spreads(group, *keys) for label, group in labelled(rows, *keys)]
    if "paired" in specification:
        return paired_table(rows, **specification["paired"])
    return pooled(rows, specification["pool"]) if "pool" in specification else rows


def metrics_of(row: Row) -> Any:
    """Return the exact metrics of a row."""
    from socialiq.evaluation.exact import Metrics

    return Metrics(*(row[name] for name in Metrics._fields))


def pooled(
    rows: Sequence[Row],
    keys: Sequence[str],
    ranges: Sequence[str] = ("angle",),
    averaged: Sequence[str] = ("regret",),
) -> list[Row]:
    """Return means over seeds of rows with equal keys.

    Args:
        rows: Rows with exact metrics, one for each seed.
        keys: Columns by which rows are put together.
        ranges: Columns of which the least and the greatest value of a single seed are returned too,
            as `..._low` and `..._high`. All three are empty if a value is unknown.
        averaged: Further columns whose means are returned.

    Returns:
        A row for each combination of the keys. Its angle is that of the mean totals.
    """
    from socialiq.evaluation.exact import mean_of

    means = []
    for label, group in labelled(rows, *keys):
        metrics = mean_of([metrics_of(row) for row in group])
        row = label | {"seeds": len(group)} | metrics._asdict()
        for name in ranges:
            known = "" not in column(group, name)
            ends = spread(group, name) if known else dict.fromkeys(("mean", "low", "high"), "")
            row.setdefault(name, ends["mean"])
            row |= {f"{name}_{end}": ends[end] for end in ("low", "high")}
        means.append(row | {name: mean(group, name) for name in averaged})
    return means


def paired_table(
    rows: Sequence[Row],
    by: str,
    reference: str,
    columns: Sequence[str],
    within: Sequence[str] = (),
    seed: str = "seed",
) -> list[Row]:
    """Test each group against a reference group, paired by training seed, with Holm's adjustment.

    Args:
        rows: A row for each group and seed.
        by: Column with the name of the group.
        reference: Name of the reference group.
        columns: Columns whose differences are tested.
        within: Rows that differ in these columns are compared separately.
        seed: Column with the training seed.

    Returns:
        A row for each test. The adjustment is over all of them; a group with fewer than two common
        seeds has no test.
    """
    tests = []
    for comparison, comparable in labelled(rows, *within):
        by_group = groups(comparable, by)
        one_of(by, reference, [name for (name,) in by_group])
        first = {row[seed]: row for row in by_group[reference,]}
        for (name,), group in by_group.items():
            pairs = [(first[row[seed]], row) for row in group if row[seed] in first]
            if name == reference or len(pairs) < 2:
                continue
            for metric in columns:
                label = comparison | {by: name, "metric": metric}
                differences = [row[metric] for _, row in pairs], [row[metric] for row, _ in pairs]
                tests.append(paired_row(label, *differences))
    return with_holm(tests)


def column(rows: Sequence[Row], name: str) -> list[Any]:
    """Return the values of a column.

    Args:
        rows: The rows.
        name: Name of the column.
    """
    return [row[name] for row in rows]


def mean(rows: Sequence[Row], name: str) -> float:
    """Return the mean of a column.

    Args:
        rows: The rows, at least one.
        name: Name of the column.
    """
    return float(np.mean(column(rows, name)))


def spread(rows: Sequence[Row], name: str) -> dict[str, float]:
    """Return statistics of a column.

    Args:
        rows: The rows, at least one.
        name: Name of the column.

    Returns:
        `mean`, and the least and largest value as `low` and `high`.
    """
    values = column(rows, name)
    return {"mean": float(np.mean(values)), "low": min(values), "high": max(values)}


def spreads(rows: Sequence[Row], *keys: str) -> Row:
    """Return the number of seeds, and mean, least and largest value of each column.

    Args:
        rows: A row for each seed; an empty cell is no value.
        *keys: Columns that are left out, as is `seed`.

    Returns:
        Column `seeds`, and each column with the suffixes `_mean`, `_low` and `_high`: empty cells
        without a value.
    """
    row: Row = {"seeds": len(rows)}
    for name in rows[0]:
        if name not in (*keys, "seed"):
            valued = [each for each in rows if each[name] != ""]
            ends = spread(valued, name) if valued else dict.fromkeys(("mean", "low", "high"), "")
            row |= {f"{name}_{end}": value for end, value in ends.items()}
    return row


def numeric_means(rows: Sequence[Row]) -> Row:
    """Return the means of the columns that are numbers in all rows."""
    names = [name for name in rows[0] if all(isinstance(row[name], int | float) for row in rows)]
    return {name: sum(row[name] for row in rows) / len(rows) for name in names}


def nested(
    rows: Sequence[Row], *keys: str, keep: str | Sequence[str] | None = None
) -> dict[str, Any]:
    """Return rows as nested mappings by the values of their keys, the outermost first.

    Args:
        rows: The rows. Of two with equal keys the later one stays.
        *keys: Columns of the keys, or texts as "%(preset)s, %(setting)s" of several columns; a
            float is written as short as it can be.
        keep: Columns that are kept; None for all except the keys, "all" for all of them. The name
            of another column stands for the value of this column in place of a mapping.
    """
    result: dict[str, Any] = {}
    for row in rows:
        branch = result
        texts = NamedRow((name, as_text(value)) for name, value in row.items())
        *above, last = (key % texts if "%" in key else texts[key] for key in keys)
        for text in above:
            branch = branch.setdefault(text, {})
        names = [name for name in row if name not in keys] if keep is None else keep
        if isinstance(names, str):
            branch[last] = dict(row) if names == "all" else row[names]
        else:
            branch[last] = {name: row[name] for name in names}
    return result


def pivoted(rows: Sequence[Row], by: str, across: str, value: str) -> list[Row]:
    """Return a row for each value of `by`, with the mean of a column for each value of `across`.

    Args:
        rows: The rows.
        by: Column whose values make the rows of the result.
        across: Column whose values make the further columns of the result.
        value: Column whose means are taken.
    """
    result: dict[Any, Row] = {}
    for (first, second), group in groups(rows, by, across).items():
        result.setdefault(first, {by: first})[as_text(second)] = mean(group, value)
    return list(result.values())


def options_name(options: Mapping[str, Any]) -> str:
    """Return changed options as a name; "default" without any."""
    return ", ".join(f"{name}={value}" for name, value in options.items()) or "default"


def paired_row(label: Row, first: Sequence[float], second: Sequence[float]) -> Row:
    """Return the test of a difference that is paired over training seeds, as a row.

    Args:
        label: First columns of the row.
        first: Values of one group.
        second: Values of another group, in the same order of seeds.

    Returns:
        The label, and the fields of `paired_difference`.
    """
    return label | paired_difference(first, second)._asdict()


def with_holm(rows: Sequence[Row]) -> list[Row]:
    """Add p-values that are adjusted by Holm's method over all rows."""
    adjusted = holm([row["p"] for row in rows]) if rows else []
    return [row | {"p_holm": float(p)} for row, p in zip(rows, adjusted, strict=True)]


def paired_differences(
    first: Sequence[Row], second: Sequence[Row], *columns: str, label: str = "metric"
) -> list[Row]:
    """Test the difference of each column between two groups of rows, with Holm's adjustment.

    Args:
        first: A row for each training seed.
        second: Rows of another group, in the same order.
        *columns: Columns whose differences are tested.
        label: Name of the column that names the tested one.

    Returns:
        A row for each test; none if there is only one seed.
    """
    if len(first) < 2:
        return []
    return with_holm(
        [
            paired_row({label: name}, [row[name] for row in first], [row[name] for row in second])
            for name in columns
        ]
    )
