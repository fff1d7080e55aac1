"""Effects of drivers on a road, by episodes without them, and the errors of Eq 4.2 about them.

A vehicle's delay is the metres that it drives to the common end without the ego, less those with
it. The measures need a world that rewards effects (`worlds.highway.effects`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol, TypeVar, cast, runtime_checkable

import gymnasium
import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from socialiq.errors import UserError
from socialiq.evaluation.exact import evaluate_exactly
from socialiq.evaluation.shield import shielded
from socialiq.evaluation.simulate import actor_of
from socialiq.statistics.intervals import normal_mean, wilson
from socialiq.types import Ending, Policy, RewardPair, Row
from socialiq.worlds.enumerate import Table
from socialiq.worlds.highway.effects import NEXT_ABSENT, RELATIONS, REPEAT, EffectOptions
from socialiq.worlds.highway.options import SOCIAL_SIGNALS, Contact
from socialiq.worlds.highway.world import RoadBatch, RoadWorld
from socialiq.worlds.intersection.crosswalk import SIGNALS
from socialiq.worlds.world import Actor

PEOPLE = tuple(name for names in SIGNALS.values() for name in names)
"""Signals of people on foot and on bicycles."""
QUANTITIES = (
    "delay", "braking", "gap_below_1_s", "waiting", "pedestrian_hit", "cyclist_delay",
    "cyclist_hit",
)  # fmt: skip
"""Quantities of an episode whose means an audit can bound (`caused`), as in `summary`."""

IN_SUMO = {
    "delay": "delay_vehicle",
    "braking": "braking_vehicle",
    "waiting": "waiting_pedestrian",
    "pedestrian_hit": "collision_pedestrian",
    "cyclist_delay": "waiting_bicycle",
    "cyclist_hit": "collision_bicycle",
}
"""Signal of a world in SUMO whose sum over an episode is a quantity."""

WAITING = "pedestrian_delay"  # signal of a gridworld: pedestrians who wait in a step for the ego

SIDE_BY_SIDE = 256  # episodes at once
LONGEST_GAP = 5.0  # s, of a post-encroachment time
CLOSE = 1.0  # s, below which it is close
MOVED = 1.0  # m, from which a vehicle is helped or harmed by an episode
SLOWED = 0.5  # m/s, from which a decision of the ego slows a vehicle down
BRAKES = 1.0  # m/s lost in a decision, from which a vehicle brakes
GAINED = 0.5  # m in the decisions ahead, from which a credited vehicle gains or loses


MOST_BEGUN = 40  # blocks of episodes whose beginnings are kept
Begun = dict[bytes, Any]
"""States at the reset of blocks of episodes, by their seeds, the world without the ego with them:
it is the same for every driver."""

Road = TypeVar("Road", bound=RoadWorld)
Counts = Int64[np.ndarray, " episode"]


class Effects(NamedTuple):
    """Effects of a driver, a row for each episode; counts are of vehicles and decisions.

    Attributes:
        totals: Sums of r_env and of the reward of effects.
        eq_4_2: Sum of Eq 4.2 on the same episodes.
        ending: Values of `Ending`.
        at_fault: Whether the ego struck the other.
        delay: Metres that others lost, by `RELATIONS`.
        braking: Hard brakings that the ego caused, less those that it prevented.
        gap: Least post-encroachment time to a vehicle of another approach, s; infinite above 5 s.
            At a recorded junction of who has a conflict area with the ego.
        helped: Vehicles that drive at least 1 m more than without the ego.
        harmed: Vehicles that drive at least 1 m less.
        charged: Brakings that Eq 4.2 charges.
        not_caused: Of these, brakings that would have happened without the ego.
        caused: Brakings by more than 1 m/s that would not.
        missed: Of these, brakings that Eq 4.2 does not charge.
        credited: Vehicles that Eq 4.2 credits as yielded to.
        gained: Of these, vehicles that gain 0.5 m in 5 decisions over an ego that accelerates.
        lost: Of these, vehicles that lose 0.5 m.
        on_foot: Sums of the signals of people (`PEOPLE`), 0 without such people.
    """

    totals: RewardPair
    eq_4_2: Float[np.ndarray, " episode"]
    ending: Int64[np.ndarray, " episode"]
    at_fault: Bool[np.ndarray, " episode"]
    delay: Float[np.ndarray, "episode relation"]
    braking: Float[np.ndarray, " episode"]
    gap: Float[np.ndarray, " episode"]
    helped: Int64[np.ndarray, " episode"]
    harmed: Int64[np.ndarray, " episode"]
    charged: Counts
    not_caused: Counts
    caused: Counts
    missed: Counts
    credited: Counts
    gained: Counts
    lost: Counts
    on_foot: Float[np.ndarray, "episode signal"]


_COUNTS = "charged", "not_caused", "caused", "missed", "credited", "gained", "lost"


def measure(
    world: RoadWorld,
    policy: Policy,
    seeds: Sequence[int] | np.ndarray,
    begun: Begun | None = None,
    judging: bool = True,
    shield: float = 0.0,
) -> Effects:
    """Drive one greedy episode for each seed, and return what the driver causes in each.

    Drivers of one world can share `begun`. Without judging, the errors of Eq 4.2 are not counted. A
    shield of some seconds brakes for people on foot.

    Raises:
        UserError: If the world doesn't measure effects, its actions are continuous, or there is no
            seed.
    """
    if world.effects is None:
        raise UserError(f"{world.name} doesn't measure effects: name {world.name}-caused")
    if world.options.continuous:
        raise UserError("effects need discrete actions: name a road that has them")
    if not len(seeds):
        raise UserError("episodes must be at least 1, got 0")
    blocks = list[dict[str, np.ndarray]]()
    for first in range(0, len(seeds), SIDE_BY_SIDE):
        block = np.asarray(seeds[first : first + SIDE_BY_SIDE])
        batch = world.batch(len(block))
        actor = actor_of(batch, shielded(policy, batch, shield))
        blocks.append(_drive(batch, actor, block, begun, judging))
    columns = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    totals = RewardPair(columns.pop("env"), columns.pop("social"))
    return Effects(totals=totals, **columns)


def measuring(world: Road, **options: Any) -> Road:
    """Return the road with the measure of effects, which changes only vehicles that come later."""
    effects = replace(world.effects or EffectOptions(), **options)
    return replace(cast(Any, world), effects=effects)


@runtime_checkable
class _Noting(Protocol):
    """Episodes side by side that note by themselves when vehicles are at one place."""

    def least_gaps(self) -> Float[np.ndarray, " row"]:
        """Return the least post-encroachment time of each episode, s."""
        ...


def caused(
    world: RoadWorld,
    actor_on: Callable[[RoadBatch], Actor],
    seeds: Int64[np.ndarray, " episode"],
    size: int,
    threads: int = 1,
    begun: Begun | None = None,
) -> Mapping[str, Float[np.ndarray, " episode"]]:
    """Drive one episode for each seed, and return what the driver causes in it: `QUANTITIES`.

    So many episodes run side by side always, since the last bits of a network depend on it. Drivers
    of one world can share `begun`.
    """
    batch, blocks = measuring(world).batch(size, threads), list[np.ndarray]()
    for first in range(0, len(seeds), size):
        block = np.resize(seeds[first : first + size], size)
        column = _drive(batch, actor_on(batch), block, begun, judging=False)
        close = column["gap"] < CLOSE
        sums = dict(zip(PEOPLE, column["on_foot"].T, strict=True))
        people = [(sums[f"{kind}_delay"], sums[f"{kind}_hit"] > 0) for kind in SIGNALS]
        vehicles = column["delay"].sum(axis=1), column["braking"], close
        blocks.append(np.stack([*vehicles, *itertools.chain(*people)]))
    columns = np.concatenate(blocks, axis=1)[:, : len(seeds)]
    return dict(zip(QUANTITIES, columns, strict=True))


def sums_in(
    env: gymnasium.Env[Any, Any], policy: Policy, seeds: Sequence[int] | np.ndarray
) -> dict[str, Float[np.ndarray, " episode"]]:
    """Drive one greedy episode of an environment for each seed; return rewards and signals, summed.

    The environment's `info` has the signals of effects, as a world in SUMO (`worlds.sumo`). The
    column `ending` has values of `Ending`.
    """
    rows = list[Row]()
    for seed in seeds:
        observation, _ = env.reset(seed=int(seed))
        ended, totals, info = False, dict[str, float](), dict[str, Any]()
        while not ended:
            action, _ = policy.predict(observation, deterministic=True)
            observation, _, terminated, truncated, info = env.step(int(action))
            own, social = info["reward_pair"].tolist()
            for name, value in ({"r_env": own, "r_caused": social} | info["signals"]).items():
                totals[name] = totals.get(name, 0.0) + value
            ended = terminated or truncated
        rows.append(totals | {"ending": Ending[info["ending"].upper()].value})
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _reset(batch: RoadBatch, seeds: np.ndarray, begun: Begun | None) -> None:
    """Begin episodes, by their state if another driver has begun them."""
    block = np.asarray(seeds, np.uint64).tobytes()
    if begun and block in begun:
        batch.restore(begun[block])
    else:
        batch.reset(seeds)
        if begun is not None and len(begun) < MOST_BEGUN:
            begun[block] = batch.save()


def _drive(
    batch: RoadBatch,
    actor: Actor,
    seeds: np.ndarray,
    begun: Begun | None = None,
    judging: bool = True,
) -> dict[str, np.ndarray]:
    """Return the columns of `Effects` of episodes that begin together, judging Eq 4.2 or not."""
    _reset(batch, seeds, begun)
    actor.begin(np.arange(len(seeds)), seeds)
    ledger, egos, options = batch.ledger, batch.egos, batch.options
    assert ledger is not None
    weights = [getattr(options, f"{name}_weight") for name in SOCIAL_SIGNALS]
    shape = (*ledger.relation.shape, options.decisions * options.frames, 3)
    tracks = np.full((0,) if isinstance(batch, _Noting) else shape, np.nan, "f4")
    sums = {name: np.zeros(len(seeds)) for name in ("env", "social", "eq_4_2", "braking")}
    counts = {name: np.zeros(len(seeds), np.int64) for name in _COUNTS}
    ending, contact = np.zeros(len(seeds), np.int64), np.zeros(len(seeds), np.int64)
    on_foot = np.zeros((len(seeds), len(PEOPLE)))
    running, number = np.ones(len(seeds), bool), 0
    while running.any():
        action = np.broadcast_to(actor.decide(batch.observation, running), len(seeds))
        ahead = _looks_ahead(batch, action, running) if judging else None
        decisions = batch.step(action, auto_reset=False, rows=running)
        eq_4_2 = sum(
            w * decisions.signals[name] for w, name in zip(weights, SOCIAL_SIGNALS, strict=True)
        )
        added = {"env": decisions.rewards.env, "social": decisions.rewards.social, "eq_4_2": eq_4_2}
        for name, column in (added | {"braking": decisions.signals["braking"]}).items():
            sums[name] += np.where(running, column, 0.0)
        if ahead is not None:
            judged = _judged(batch, ahead, egos, decisions.signals["yielding"])
            for name, column in judged.items():
                counts[name] += np.where(running, column, 0)
        if tracks.size:
            frames = slice(number * options.frames, (number + 1) * options.frames)
            _follow(batch, running, tracks[:, :, frames])
        for column, name in enumerate(PEOPLE):
            on_foot[running, column] += decisions.signals.get(name, np.zeros(len(seeds)))[running]
        ending[running], contact[running] = decisions.ending[running], decisions.contact[running]
        running &= decisions.ending == int(Ending.NONE)
        number += 1
    lost = ledger.without[..., 0] - ledger.driven[..., 0]
    if isinstance(batch, _Noting):
        gap = batch.least_gaps()
    else:
        gap = _gaps(tracks, egos, ledger.relation, options.simulation_frequency)
    kinds = ledger.relation[..., None] == np.arange(len(RELATIONS))
    in_both = (ledger.relation >= 0) & (ledger.without[..., 0] > 0) & (ledger.driven[..., 0] > 0)
    return {
        **sums,
        **counts,
        "on_foot": on_foot,
        "ending": ending,
        "at_fault": contact == int(Contact.EGO_STRUCK),
        "delay": (lost[..., None] * kinds).sum(axis=1),
        "gap": np.where(gap > LONGEST_GAP, np.inf, gap),
        "helped": (in_both & (lost <= -MOVED)).sum(axis=1),
        "harmed": (in_both & (lost >= MOVED)).sum(axis=1),
    }


class _Ahead(NamedTuple):
    """Motion of others from here, by identity: speeds after a decision, metres of several."""

    absent_speed: Float[np.ndarray, "row vehicle"]
    repeated: Float[np.ndarray, "row vehicle"]
    accelerating: Float[np.ndarray, "row vehicle"]


def _looks_ahead(batch: RoadBatch, action: np.ndarray, running: np.ndarray) -> _Ahead:
    ledger = batch.ledger
    assert ledger is not None
    batch.measure(NEXT_ABSENT, running)
    absent_speed = ledger.ahead[..., 0].copy()
    batch.measure(REPEAT + batch.faster, running)
    accelerating = ledger.ahead[..., 1].copy()
    repeated = accelerating.copy()
    for number in np.setdiff1d(action[running], [batch.faster]).tolist():
        taking = running & (action == number)
        # below 0 it drives as others do, which is behind the actions
        batch.measure(REPEAT + (number if number >= 0 else batch.n_actions), taking)
        repeated[taking] = ledger.ahead[taking, :, 1]
    return _Ahead(absent_speed, repeated, accelerating)


def _judged(
    batch: RoadBatch, ahead: _Ahead, egos: np.ndarray, yielding: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the counts of the last decision: charges and credits of Eq 4.2 against causes."""
    buffers = batch.buffers
    before, after = buffers.before, buffers.after
    slots = np.arange(before.shape[1])
    identity = after["identity"]
    others = (slots < buffers.present[:, :1]) & (identity != egos[:, None]) & ~after["crashed"]
    absent = np.take_along_axis(ahead.absent_speed, identity.astype(np.int64), axis=1)
    slowed = others & (absent - after["speed"] > SLOWED)  # NaN compares as false
    charged = others & ~np.isnan(absent) & buffers.braking
    caused = slowed & (before["speed"] - after["speed"] > BRAKES)
    credited = others & (yielding > 0)[:, None] & batch.credited
    gain = np.take_along_axis(
        ahead.repeated - ahead.accelerating, identity.astype(np.int64), axis=1
    )
    columns = {
        "charged": charged,
        "not_caused": charged & ~slowed,
        "caused": caused,
        "missed": caused & ~buffers.braking,
        "credited": credited,
        "gained": credited & (gain > GAINED),
        "lost": credited & (gain < -GAINED),
    }
    return {name: column.sum(axis=1) for name, column in columns.items()}


def _follow(batch: RoadBatch, running: np.ndarray, tracks: Float32[np.ndarray, "r v f 3"]) -> None:
    """Write where the vehicles of a decision were, by identity and frame."""
    buffers = batch.buffers
    driving = running[:, None] & (np.arange(buffers.after.shape[1]) < buffers.present[:, :1])
    row, slot = np.nonzero(driving)
    vehicles = buffers.trace[row, :, slot]  # (vehicle, frame)
    identity = buffers.after["identity"][row, slot]
    tracks[row, identity] = np.stack([vehicles[name] for name in ("x", "y", "heading")], axis=-1)


def _gaps(tracks: np.ndarray, egos: np.ndarray, relation: np.ndarray, frequency: int) -> np.ndarray:
    """Return the least post-encroachment time of each episode, s."""
    from socialiq.worlds.highway.core.compile import run_in_parts  # imports Numba
    from socialiq.worlds.highway.core.effects import encroachment

    window, gaps = int(LONGEST_GAP * frequency), np.zeros(len(egos), np.int64)
    arguments = tracks, egos.astype(np.int64), relation, window, gaps
    run_in_parts(encroachment, 1, len(egos), *arguments)
    return np.where(gaps > window, np.inf, gaps / frequency)


def cells_lost(table: Table) -> Float[np.ndarray, "state action"]:
    """Return the expected cells that others lose in each step of a gridworld by the ego, exactly.

    The rules give the same step without the ego, which has arrived there. The table has all states.
    Vehicles don't react to each other, so the sum over an episode is the delay to any later end.
    """
    mdp, states = table.mdp, table.states
    others = [
        number
        for number, feature in enumerate(table.world.features)
        if feature.name.startswith("y_") and feature.name != "y_ego"
    ]
    absent = states.copy()
    absent[:, 0] = states[:, 0].max()
    alone = mdp.successor[table.world.index(absent), 0]  # (state, chance)
    lost = states[alone][:, None][..., others] - states[mdp.successor][..., others]
    return (mdp.probability * lost.sum(axis=-1)).sum(axis=-1)


def caused_by_step(table: Table) -> dict[str, Float[np.ndarray, "state action"]]:
    """Return the expected effects of each step of a gridworld on others, by quantity.

    They are the delay of vehicles in cells, and where there are pedestrians their waiting in steps.
    """
    waiting = {"waiting": table.signals[WAITING]} if WAITING in table.signals else {}
    return {"delay": cells_lost(table)} | waiting


def expected_delay(table: Table, chances: Float[np.ndarray, "*time state action"]) -> float:
    """Return the cells that others lose in an episode of a policy on average, exactly."""
    lost = cells_lost(table)
    mdp = replace(table.mdp, rewards=RewardPair(lost, lost))
    return evaluate_exactly(replace(table, mdp=mdp), chances).r_env


def _share(name: str, happened: Bool[np.ndarray, " episode"]) -> Row:
    value, low, high = wilson(int(happened.sum()), len(happened))
    return {name: value, f"{name}_low": low, f"{name}_high": high}


def shares_of(endings: Int64[np.ndarray, " episode"]) -> Row:
    """Return the shares of arrivals and collisions with 95 % intervals."""
    kinds = ("arrival", Ending.ARRIVAL), ("collision", Ending.COLLISION)
    rows = [_share(name, endings == int(ending)) for name, ending in kinds]
    return rows[0] | rows[1]


def summary(effects: Effects) -> Row:
    """Return means with 95 % intervals: metres, brakings, shares, and the errors of Eq 4.2."""
    row: Row = {"episodes": len(effects.ending)}
    row |= normal_mean("r_env", effects.totals.env) | normal_mean("r_caused", effects.totals.social)
    row |= normal_mean("r_eq_4_2", effects.eq_4_2) | normal_mean("delay", effects.delay.sum(axis=1))
    for number, name in enumerate(RELATIONS):
        row |= normal_mean(f"delay_{name}", effects.delay[:, number])
    row |= normal_mean("braking", effects.braking)
    row |= _share("gap_below_1_s", effects.gap < CLOSE)
    row |= _share("gap_below_2_s", effects.gap < 2.0)
    row |= normal_mean("helped", effects.helped) | normal_mean("harmed", effects.harmed)
    row |= shares_of(effects.ending) | _share("at_fault", effects.at_fault)
    sums_of = dict(zip(PEOPLE, effects.on_foot.T, strict=True))
    for kind, names in SIGNALS.items():
        if any(sums_of[name].any() for name in names):
            row |= normal_mean(f"{kind}_delay", sums_of[f"{kind}_delay"])
            row |= _share(f"{kind}_hit", sums_of[f"{kind}_hit"] > 0)
    sums = {name: int(getattr(effects, name).sum()) for name in _COUNTS}

    def ratio(part: str, of: str) -> Row:
        return {f"{part}_of_{of}": sums[part] / sums[of] if sums[of] else np.nan}

    row |= {"charged": sums["charged"], "caused": sums["caused"]}
    row |= ratio("not_caused", "charged") | ratio("missed", "caused")
    row |= {"credited": sums["credited"]}
    return row | ratio("gained", "credited") | ratio("lost", "credited")
