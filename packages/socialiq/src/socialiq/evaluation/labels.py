"""Labels of demonstrations, the reward pair of each step, recomputed where the world is known.

A gridworld's table has the pair of every state and action. An episode of a road is driven again by
its recorded actions from its recorded seed, which gives every observation and label bit by bit.
What a file says about its world and seeds is a claim of its author: a false one makes episodes
disagree, it does not make a false label true.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from jaxtyping import Bool

from socialiq.demonstrations.columns import steps_of
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import MIXTURES
from socialiq.errors import UserError
from socialiq.evaluation.rollout import transitions_of
from socialiq.evaluation.simulate import ScriptedActor, simulate
from socialiq.types import Ending
from socialiq.worlds import IDS, OLD_IDS, SCENE_IDS, catalogue, grammar
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.world import World

TOLERANCE = 1e-4
"""Largest difference of a label from its world's; environments may record in float32."""
BLOCK = 512  # episodes that are driven again side by side
MOST_SEEDS = 1_000_000  # of one source
_KEEPS_ROWS = (*MIXTURES, "concatenate", "subsample", "one_of_each_block")


class Recomputed(NamedTuple):
    """Outcome of a check of labels."""

    agrees: Bool[np.ndarray, " episode"]  # whether all of an episode's labels are its world's
    world: str  # its name; "" if no label could be recomputed, and then all episodes agree
    reason: str = ""  # why none could


def recompute(data: Demonstrations) -> Recomputed:
    """Compare every episode's labels with those of the world that the table's source names.

    Rows of a gridworld must be possible transitions, and a road's episodes must be whole.
    """
    sources = list(_sources(data.source))
    worlds = {world.description: world for world in map(_world_of, sources) if world}
    unchecked = np.ones(data.n_episodes, bool)
    if not all(map(_world_of, sources)):
        return Recomputed(unchecked, "", "it names no world of ours")
    if len(worlds) > 1:
        return Recomputed(unchecked, "", "it is of several worlds")
    (world,) = worlds.values()
    if data.n_features not in (world.n_features, world.n_features + 1):
        return Recomputed(unchecked, "", f"its observations are not those of {world.name}")
    if isinstance(world, GridWorld):
        bad = ~_agree_with_table(world, data)
        return Recomputed(np.bincount(data.episode, bad) == 0, world.name)
    if (data.step != steps_of(data.episode)).any():
        return Recomputed(unchecked, "", "its episodes miss steps, so they can't be driven again")
    return Recomputed(_agree_when_driven(world, sources, data), world.name)


def trusted(data: Demonstrations, name: str) -> tuple[Demonstrations, str]:
    """Return the episodes whose labels are their world's, and a line about the rest.

    There is no line if all are.

    Raises:
        UserError: If more than half of the episodes disagree: the labels are not of that world.
    """
    agrees, world, reason = recompute(data)
    if not world:
        line = f"the labels of {name} can't be recomputed: {reason}"
        return data, f"{line}; `socialiq data trust {name}` tests whether they are consistent"
    dropped = np.flatnonzero(~agrees)
    if not len(dropped):
        return data, ""
    said = f"the labels of {len(dropped)} of {len(agrees)} episodes are not those of {world}"
    if 2 * len(dropped) > len(agrees):
        raise UserError(
            f"{name}: {said}: if it has other rewards on purpose, train with --believe-labels"
        )
    numbers = ", ".join(map(str, dropped[:8])) + (", ..." if len(dropped) > 8 else "")
    return data.select(np.flatnonzero(agrees)), f"{name}: {said}: dropped {numbers}"


def _sources(source: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Yield the sources that a table was mixed from; an empty one where that isn't known."""
    inner = source.get("of")
    if source.get("made_by") not in _KEEPS_ROWS or not inner:
        yield {} if "made_by" in source else source
        return
    if isinstance(inner, Mapping):
        inner = [inner] if {"world", "made_by"} & {*inner} else list(inner.values())
    for part in inner:
        yield from _sources(part if isinstance(part, Mapping) else {})


def world_named(name: str, **options: Any) -> World | None:
    """Return the world of ours with a name, a Gymnasium id or a description; else None.

    Options of the environment alone, such as its clock, don't count.
    """
    names = {identity: plain for plain, identity in (IDS | OLD_IDS | SCENE_IDS).items()}
    is_description = re.match(r"\S+ \w*Options\(", name) is not None
    text = name.partition(" ")[0] if is_description else names.get(name, name)
    if catalogue.base(text) not in catalogue.NAMES:
        return None
    of_world = {
        name: value for name, value in options.items() if name not in catalogue.OF_CONSTRUCTOR
    }
    world = grammar.build(text, of_world)
    return None if is_description and name != world.description else world


def world_of(data: Demonstrations) -> World | None:
    """Return the one world of ours that the sources of demonstrations name; else None."""
    worlds = {world and world.description: world for world in map(_world_of, _sources(data.source))}
    return next(iter(worlds.values())) if len(worlds) == 1 else None


def _world_of(source: Mapping[str, Any]) -> World | None:
    return world_named(str(source.get("world")), **source.get("options", {}))


def _agree_with_table(world: GridWorld, data: Demonstrations) -> Bool[np.ndarray, " transition"]:
    """Return whether each row is a possible transition with the pair of its state and action."""
    mdp = tabulate(world).mdp
    shape = np.array(world.shape)
    low = np.array([feature.low for feature in world.features])
    states = []
    inside = np.ones(data.n_transitions, bool)
    for observed in (data.observation, data.next_observation):
        values = observed[:, : len(low)]
        whole = np.clip(np.rint(values), low, low + shape - 1)
        inside &= (whole == values).all(axis=1)
        states.append(world.index(whole.astype(np.int64)))
    row = states[0], data.action
    ending = np.where(data.ending == Ending.TIMEOUT, int(Ending.NONE), data.ending)
    possible = (mdp.successor[row] == states[1][:, None]) & (mdp.probability[row] > 0)
    possible &= mdp.ending[row] == ending[:, None]
    gap = np.max(
        [np.abs(r - of[row]) for r, of in zip(data.rewards, mdp.rewards, strict=True)], axis=0
    )
    return inside & possible.any(axis=1) & (gap <= TOLERANCE)


def _agree_when_driven(
    world: World, sources: Sequence[Mapping[str, Any]], data: Demonstrations
) -> Bool[np.ndarray, " episode"]:
    """Return whether each episode, driven again from its seed, has the same rows and labels.

    Its seed is the one of its source's whose episode begins with its first observation.
    """
    begins = data.observation[data.episode_starts, : world.n_features]
    wanted = {row.tobytes() for row in begins}
    seed_of = {}
    for block in _blocks(_recorded_seeds(sources, data.n_episodes)):
        rows = np.asarray(world.batch(len(block)).reset(block), np.float32)
        starts = zip((row.tobytes() for row in rows), block.tolist(), strict=True)
        seed_of |= {start: seed for start, seed in starts if start in wanted}
    seeds = np.array([seed_of.get(row.tobytes(), -1) for row in begins])
    agrees = seeds >= 0
    for block in _blocks(np.flatnonzero(agrees)):
        agrees[block] = _driven_alike(world, seeds[block], data.select(block))
    return agrees


def _recorded_seeds(sources: Sequence[Mapping[str, Any]], episodes: int) -> np.ndarray:
    """Return every seed that sources name; without a number of episodes as many as the table's."""
    ranges = [np.zeros(0, np.int64)]
    for source in sources:
        listed = source.get("seeds")
        if isinstance(listed, list) and all(map(_is_seed, listed)):
            ranges.append(np.array(listed, np.int64))
        first = source.get("first_seed", source.get("seed"))
        count = source.get("episodes")
        if _is_seed(first):
            count = min(count, MOST_SEEDS) if _is_seed(count) else episodes
            ranges.append(first + np.arange(count))
    return np.unique(np.concatenate(ranges))


def _is_seed(value: Any) -> TypeGuard[int]:
    return isinstance(value, int) and 0 <= value < 2**62


def _driven_alike(
    world: World, seeds: np.ndarray, data: Demonstrations
) -> Bool[np.ndarray, " episode"]:
    """Drive episodes again side by side by their actions; return which have the same rows."""
    lengths = data.episode_lengths
    width = world.n_features
    script = np.zeros(
        (int(lengths.max()), *data.action[data.episode_starts].shape), data.action.dtype
    )
    script[data.step, data.episode] = data.action
    last = len(script) - 1
    actor = ScriptedActor(lambda time, *_: script[min(time, last)])
    again, _ = transitions_of(simulate(world.batch(len(seeds)), actor, seeds))
    rows = np.bincount(again["episode"], minlength=len(seeds)) == lengths
    # Rows of both in the order of the table; an episode of another length has none of its own.
    kept = rows[data.episode]
    there = rows[again["episode"]]
    same = data.ending[kept] == again["ending"][there]
    for name in ("observation", "next_observation"):
        recorded = getattr(data, name)[kept, :width]
        same &= (recorded == np.asarray(again[name][there], np.float32)).all(axis=1)
    for label, of_world in zip(data.rewards, again["rewards"], strict=True):
        same &= np.abs(label[kept] - of_world[there]) <= TOLERANCE
    return rows & (np.bincount(data.episode[kept], ~same, len(seeds)) == 0)


def _blocks(values: np.ndarray) -> Iterator[np.ndarray]:
    for first in range(0, len(values), BLOCK):
        yield values[first : first + BLOCK]
