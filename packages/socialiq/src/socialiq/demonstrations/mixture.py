"""Mixtures of demonstrators in one set: whole episodes, drawn without replacement.

The thesis mixes "equal proportions of ... demonstrations" in 5.2 and equal parts of "transitions"
in 6.3. These differ wherever modes differ in how long they take, since a learner samples
transitions: in the 7x7 world, whose altruistic expert waits, 77 % of the transitions of equal
trajectories are altruistic (docs/reproduction/grid.md). Each interpretation is a function here and
none is the default.

Pools map a mode's name to demonstrations of that mode alone. The episodes of a pool are a beginning
of one seeded order, so a larger draw contains a smaller one of the same seed. The result holds the
pools in the mapping's order, under all their mode names. A pool that is too small is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Int

from socialiq.demonstrations import columns
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of

Pools = Mapping[str, Demonstrations]


def equal_trajectories(pools: Pools, episodes_each: int, seed: int) -> Demonstrations:
    """Mix the same number of episodes of every mode (thesis 5.2).

    Args:
        pools: Demonstrations by mode.
        episodes_each: Episodes of each mode.
        seed: Seed of the draw.

    Raises:
        UserError: If a pool is too small or holds another mode, or a number is out of range.
    """
    _at_least_one("episodes_each", episodes_each)
    recipe = {"made_by": "equal_trajectories", "episodes_each": episodes_each, "seed": seed}
    return _draw(pools, dict.fromkeys(pools, episodes_each), seed, recipe)


def equal_transitions(pools: Pools, transitions_each: int, seed: int) -> Demonstrations:
    """Mix the same number of transitions of every mode, as nearly as whole episodes can (6.3).

    A mode's episodes are taken until its number of transitions is as close as it gets, so it is
    off by at most half of the episode at the boundary, and by less than one episode's length.

    Args:
        pools: Demonstrations by mode.
        transitions_each: Transitions of each mode.
        seed: Seed of the draw.

    Raises:
        UserError: If a pool is too small or holds another mode, or a number is out of range.
    """
    _at_least_one("transitions_each", transitions_each)
    counts = {}
    for mode, order in _orders(pools, seed).items():
        if pools[mode].n_transitions < transitions_each:
            raise UserError(
                f"mode '{mode}' needs {transitions_each} transitions and its pool has "
                f"{pools[mode].n_transitions}: record more or ask for fewer"
            )
        reached = np.cumsum(pools[mode].episode_lengths[order])
        counts[mode] = int(np.abs(reached - transitions_each).argmin()) + 1
    recipe = {"made_by": "equal_transitions", "transitions_each": transitions_each, "seed": seed}
    return _draw(pools, counts, seed, recipe)


def weighted(
    pools: Pools, weights: Mapping[str, float], episodes: int, seed: int
) -> Demonstrations:
    """Mix a number of episodes, in all, in which each mode has its share by its weight.

    Args:
        pools: Demonstrations by mode.
        weights: Weight of each mode, not negative; a share is a weight divided by their sum.
        episodes: Number of episodes in all.
        seed: Seed of the draw.

    Raises:
        UserError: If the weights do not fit the pools, or a pool is too small.
    """
    if set(weights) != set(pools):
        raise UserError(
            f"weights name {', '.join(weights)} where the pools are {', '.join(pools)}: "
            "give each pool one weight"
        )
    counts = apportion(weights, episodes)
    recipe = {"made_by": "weighted", "weights": dict(weights), "episodes": episodes, "seed": seed}
    return _draw(pools, {mode: counts[mode] for mode in pools}, seed, recipe)


def contaminated(
    pools: Pools, base: str, contaminant: str, share: float, episodes: int, seed: int
) -> Demonstrations:
    """Mix a mode with a share of another, in [0, 1]: the malicious case of thesis 1 and 8.3.

    Args:
        pools: Demonstrations by mode.
        base: The mode.
        contaminant: The mode that contaminates it.
        share: Share of the contaminant's episodes, in [0, 1].
        episodes: Number of episodes in all.
        seed: Seed of the draw.

    Raises:
        UserError: If a mode has no pool, both are the same, the share is out of range, or a pool is
            too small.
    """
    one_of("mode", base, list(pools))
    one_of("mode", contaminant, list(pools))
    if base == contaminant:
        raise UserError(f"mode '{base}' cannot contaminate itself: name another mode")
    if not 0.0 <= share <= 1.0:
        raise UserError(f"share {share:g} is outside [0, 1]: give the contaminant's share")
    counts = apportion({base: 1.0 - share, contaminant: share}, episodes)
    recipe = {"made_by": "contaminated", "base": base, "contaminant": contaminant}
    recipe |= {"share": share, "episodes": episodes, "seed": seed}
    return _draw({mode: pools[mode] for mode in (base, contaminant)}, counts, seed, recipe)


MIXTURES: dict[str, Callable[..., Demonstrations]] = {
    "equal_trajectories": equal_trajectories,
    "equal_transitions": equal_transitions,
    "weighted": weighted,
    "contaminated": contaminated,
}


def concatenate(tables: Sequence[Demonstrations]) -> Demonstrations:
    """Put tables end to end, their episodes renumbered in order.

    Modes are matched by name, in the order of their first appearance. Where all sources are one,
    it is kept; otherwise the distinct ones are listed. All need equal features and actions.
    """
    if not tables:
        raise UserError("no demonstrations to concatenate: pass at least one table")
    for what in ("n_features", "n_actions", "action_size"):
        values = {getattr(table, what) for table in tables}
        if len(values) > 1:
            raise UserError(
                f"demonstrations differ in {what} ({', '.join(map(str, sorted(values)))}): "
                "record them in one world with one encoding"
            )
    mode_names = tuple(dict.fromkeys(name for table in tables for name in table.mode_names))
    contents = [table.with_mode_names(mode_names).arrays() for table in tables]
    arrays = {
        name: np.concatenate([content[name] for content in contents]) for name in columns.LAYOUT
    }
    sizes = np.array([table.n_episodes for table in tables])
    first = np.repeat(np.cumsum(sizes) - sizes, [table.n_transitions for table in tables])
    arrays["episode"] = (arrays["episode"] + first).astype(np.int32)
    sources: list[dict[str, Any]] = []
    for table in tables:
        if table.source not in sources:
            sources.append(table.source)
    source = sources[0] if len(sources) == 1 else {"made_by": "concatenate", "of": sources}
    return Demonstrations.of_arrays(arrays, mode_names, tables[0].n_actions, source)


def apportion(weights: Mapping[str, float], total: int) -> dict[str, int]:
    """Divide a whole number by weights, by the method of largest remainders.

    Each count is its exact share rounded down or up, and the counts sum to `total`. Of equal
    remainders the earlier name is rounded up.

    Args:
        weights: Weights by name, finite and not negative.
        total: The number to divide, at least 1.

    Returns:
        Counts by name.

    Raises:
        UserError: If the total is below 1, or the weights are invalid or all 0.
    """
    _at_least_one("episodes", total)
    values = np.array(list(weights.values()), np.float64)
    if not np.isfinite(values.sum()) or (values < 0).any() or values.sum() <= 0:
        raise UserError("weights must be finite, not negative and not all 0")
    exact = values / values.sum() * total
    counts = np.floor(exact).astype(int)
    # Rounded, so that a tie is one in spite of the last bits (0.07 * 50 > 3.5).
    by_remainder = np.argsort(-np.round(exact - counts, 9), kind="stable")
    counts[by_remainder[: total - counts.sum()]] += 1
    return {name: int(count) for name, count in zip(weights, counts, strict=True)}


def _at_least_one(what: str, number: int) -> None:
    if number < 1:
        raise UserError(f"{what} is {number}: ask for at least 1")


def _orders(pools: Pools, seed: int) -> dict[str, Int[np.ndarray, " episode"]]:
    """Check the pools, and give each a seeded order of its episodes."""
    if seed < 0:
        raise UserError(f"seed {seed} is negative: use 0 or more")
    if not pools:
        raise UserError("no pools to mix: pass at least one mode's demonstrations")
    for mode, pool in pools.items():
        strange = [name for name, (size, _) in pool.counts().items() if size and name != mode]
        if strange:
            raise UserError(
                f"the pool of mode '{mode}' has episodes of '{strange[0]}': pass one mode per pool"
            )
    return {
        mode: np.random.default_rng([seed, index]).permutation(pool.n_episodes)
        for index, (mode, pool) in enumerate(pools.items())
    }


def _draw(
    pools: Pools, counts: Mapping[str, int], seed: int, recipe: dict[str, Any]
) -> Demonstrations:
    """Take the counted episodes of each pool; `source` records recipe and sources."""
    tables = []
    for mode, order in _orders(pools, seed).items():
        if len(order) < counts[mode]:
            raise UserError(
                f"mode '{mode}' needs {counts[mode]} episodes and its pool has {len(order)}: "
                "record more or ask for fewer"
            )
        # A mode whose share is 0 has no rows, but its name stays.
        if counts[mode] > 0:
            tables.append(pools[mode].select(order[: counts[mode]]).with_mode_names(tuple(pools)))
    mixed = concatenate(tables)
    source = {**recipe, "of": {mode: pool.source for mode, pool in pools.items()}}
    return Demonstrations.of_arrays(mixed.arrays(), mixed.mode_names, mixed.n_actions, source)
