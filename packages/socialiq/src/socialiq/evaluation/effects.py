"""Effects of drivers on a road, by episodes without them, and the errors of Eq 4.2 about them.

A vehicle's delay is the metres that it drives to the common end without the ego, less those with
it. The measures need a world that rewards effects (`worlds.highway.effects`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol, TypeVar, cast, runtime_checkable

import gymnasium
import numpy as np
from jaxtyping import Float, Float32, Int64

from socialiq.errors import UserError
from socialiq.evaluation import measures
from socialiq.evaluation.exact import evaluate_exactly
from socialiq.evaluation.measures import DECISION, Episodes, Quantity, columns_of, joined
from socialiq.evaluation.shield import shielded
from socialiq.evaluation.simulate import GymActor, GymSimulator, actor_of, simulate
from socialiq.types import Policy, RewardPair, Row
from socialiq.worlds.enumerate import Table
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.effects import NEXT_ABSENT, RELATIONS, REPEAT, EffectOptions
from socialiq.worlds.highway.options import SOCIAL_SIGNALS
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.road_users import ROAD_USERS
from socialiq.worlds.world import Actor

PEOPLE = tuple(name for user in ROAD_USERS for name in user.signals)
"""Signals of people of all classes."""
DELAYS_AND_HITS = tuple(f"{user.name}_{what}" for user in ROAD_USERS for what in ("delay", "hit"))
"""Columns of `summary` on people of all classes."""
_SIGNALS = ("braking", *PEOPLE)
_OF_PEOPLE = tuple(name for user in ROAD_USERS for name in (user.delay, f"{user.name}_hit"))
QUANTITIES = ("delay", "braking", "gap_below_1_s", *_OF_PEOPLE)
"""Quantities of an episode whose means an audit can bound (`caused`), as in `summary`."""

IN_SUMO = {"delay": "delay_vehicle", "braking": "braking_vehicle"}
for _user in ROAD_USERS:
    if _user.sumo.name:
        IN_SUMO[_user.delay] = f"waiting_{_user.sumo.name}"
        IN_SUMO[f"{_user.name}_hit"] = f"collision_{_user.sumo.name}"
"""Signal of a world in SUMO whose sum over an episode is a quantity."""

WAITING = "pedestrian_delay"  # signal of a gridworld: pedestrians who wait in a step for the ego

SIDE_BY_SIDE = 256  # episodes at once
LONGEST_GAP = 5.0  # s, of a post-encroachment time
MOVED = 1.0  # m, from which a vehicle is helped or harmed by an episode
SLOWED = 0.5  # m/s, from which a decision of the ego slows a vehicle down
BRAKES = 1.0  # m/s lost in a decision, from which a vehicle brakes
GAINED = 0.5  # m in the decisions ahead, from which a credited vehicle gains or loses


MOST_BEGUN = 40  # blocks of episodes whose beginnings are kept
Begun = dict[bytes, Any]
"""States at the reset of blocks of episodes, by their seeds, the world without the ego with them:
it is the same for every driver."""

Road = TypeVar("Road", bound=RoadWorld)
COUNTS = "charged", "not_caused", "caused", "missed", "credited", "gained", "lost"
"""Brakings that Eq 4.2 charges, and of these those that would have happened without the ego;
brakings by more than 1 m/s that would not, and of these those that it does not charge; vehicles
that it credits as yielded to, and of these those that gain or lose 0.5 m in 5 decisions over an ego
that accelerates."""


def measure(
    world: RoadWorld,
    policy: Policy,
    seeds: Sequence[int] | np.ndarray,
    begun: Begun | None = None,
    judging: bool = True,
    shield: float = 0.0,
) -> Episodes:
    """Drive one greedy episode for each seed, and return what the driver causes in each.

    Args:
        world: Road that measures effects.
        policy: Policy that drives.
        seeds: Seed of each episode.
        begun: Beginnings of episodes, which drivers of one world can share; None to keep none.
        judging: Whether the errors of Eq 4.2 are counted. With continuous actions they are not,
            since these can't be compared with the other ones.
        shield: Time to collision with a person below which the ego brakes, s; 0 for no shield.

    Returns:
        Columns of each episode: `r_env` and `r_social`, the reward of effects; `r_eq_4_2`, the sum
        of Eq 4.2 on the same episode; `ending` and `contact`; `delay`, the metres that others lost,
        and `delay_RELATION` by `RELATIONS`; the sums of the signals `signal_braking`, hard brakings
        that the ego caused less those that it prevented, and `signal_NAME` of `PEOPLE`, 0 without
        such people; `gap`, the least post-encroachment time to a vehicle of another approach (at a
        recorded junction, to one whose way has a conflict area with the ego's), s, infinite above
        5 s; `helped` and `harmed`, the vehicles that drive at least 1 m more or less than without
        the ego; and `COUNTS`.

    Raises:
        UserError: If the world doesn't measure effects, or there is no seed.
    """
    if world.effects is None:
        raise UserError(f"{world.name} doesn't measure effects: add reward=caused")
    judging = judging and not world.options.continuous
    if not len(seeds):
        raise UserError("episodes must be at least 1, got 0")
    blocks = list[Episodes]()
    for first in range(0, len(seeds), SIDE_BY_SIDE):
        block = np.asarray(seeds[first : first + SIDE_BY_SIDE])
        batch = world.batch(len(block))
        actor = actor_of(batch, shielded(policy, batch, shield))
        blocks.append(_drive(batch, actor, block, begun, judging))
    return joined(blocks)


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

    Args:
        world: The road.
        actor_on: Function that returns the driver's actor on a batch.
        seeds: Seed of each episode.
        size: Number of episodes that always run side by side, since the last bits of a network
            depend on it.
        threads: Number of threads that drive them.
        begun: Beginnings of episodes, which drivers of one world can share; None to keep none.

    Returns:
        A value for each episode by the name of the quantity.
    """
    batch = measuring(world).batch(size, threads)
    blocks = list[Episodes]()
    for first in range(0, len(seeds), size):
        block = np.resize(seeds[first : first + size], size)
        blocks.append(_drive(batch, actor_on(batch), block, begun, judging=False))
    effects = joined(blocks).rows(slice(len(seeds)))
    return {name: effects[name].astype(np.float64) for name in QUANTITIES}


def sums_in(
    env: gymnasium.Env[Any, Any], policy: Policy, seeds: Sequence[int] | np.ndarray
) -> Episodes:
    """Drive one greedy episode of an environment for each seed; return rewards and signals, summed.

    Args:
        env: Environment whose `info` has the signals of effects, as a world in SUMO
            (`worlds.sumo`).
        policy: Policy that drives.
        seeds: Seed of each episode.

    Returns:
        Columns `r_env`, `r_caused` and the signals by name; `ending` has values of `Ending`.
    """
    quantities = {
        "r_env": DECISION["r_env"],
        "r_caused": DECISION["r_social"],
        "": DECISION["signal"],
    }
    simulator = GymSimulator(env)
    steps = simulate(simulator, GymActor(policy, simulator=simulator), seeds)
    results = columns_of(steps, len(seeds), quantities)
    del results["contact"]
    return Episodes(results, ending=results.pop("ending"))


class _Judged:
    """Episodes of a road as a simulator that judges each decision by Eq 4.2 and by its effects.

    All episodes begin at once, by their state if another driver has begun them.

    Attributes:
        counts: Counts of the last decision, `COUNTS` by name; empty if not judged.
        tracks: Places of vehicles at each sub-step; empty if the batch notes the gaps.
    """

    def __init__(self, batch: RoadBatch, begun: Begun | None, judging: bool) -> None:
        assert batch.ledger is not None
        options = batch.options
        shape = (*batch.ledger.relation.shape, options.decisions * options.frames, 3)
        self.size = batch.size
        self.counts = dict[str, np.ndarray]()
        self.tracks = np.full((0,) if isinstance(batch, _Noting) else shape, np.nan, "f4")
        self._batch = batch
        self._begun = begun
        self._judging = judging
        self._decision = 0

    @property
    def observation(self) -> np.ndarray:
        """Current observations."""
        return self._batch.observation

    @property
    def shown_rows(self) -> np.ndarray:
        """Rows of road users that are shown."""
        return self._batch.shown_rows

    def seen_by(self, policy: Any) -> np.ndarray:
        """Return what a policy observes."""
        return self._batch.seen_by(policy)

    def reset(self, seeds: Any = None, rows: Any = None) -> np.ndarray:  # noqa: ARG002  all rows
        """Begin the episodes."""
        block = np.asarray(seeds, np.uint64).tobytes()
        if self._begun and block in self._begun:
            self._batch.restore(self._begun[block])
        else:
            self._batch.reset(seeds)
            if self._begun is not None and len(self._begun) < MOST_BEGUN:
                self._begun[block] = self._batch.save()
        self.egos = self._batch.egos
        return self.observation

    def step(self, actions: Any, auto_reset: bool = False, rows: Any = None) -> Any:
        """Take a decision and judge it."""
        batch = self._batch
        action = actions if np.ndim(actions) == 2 else np.broadcast_to(actions, self.size)
        ahead = _looks_ahead(batch, action, rows) if self._judging else None
        decisions = batch.step(action, auto_reset, rows)
        if ahead is not None:
            self.counts = _judged(batch, ahead, self.egos, decisions.signals["yielding"])
        if self.tracks.size:
            frames = batch.options.frames
            first = self._decision * frames
            _follow(batch, rows, self.tracks[:, :, first : first + frames])
        self._decision += 1
        return decisions


def _drive(
    batch: RoadBatch,
    actor: Actor,
    seeds: np.ndarray,
    begun: Begun | None = None,
    judging: bool = True,
) -> Episodes:
    """Return the columns of `measure` of episodes that begin together, judging Eq 4.2 or not."""
    simulator = _Judged(batch, begun, judging)
    options = batch.options
    weights = {name: getattr(options, f"{name}_weight") for name in SOCIAL_SIGNALS}
    absent = np.zeros(len(seeds))
    quantities = {
        "r_env": DECISION["r_env"],
        "r_social": DECISION["r_social"],
        "r_eq_4_2": Quantity(
            "reward",
            lambda step: sum(weight * step.made.signals[name] for name, weight in weights.items()),
        ),
        "signal": Quantity(
            "", lambda step: {name: step.made.signals.get(name, absent) for name in _SIGNALS}
        ),
        "": Quantity("", lambda _: simulator.counts or dict.fromkeys(COUNTS, absent), "count"),
    }
    results = columns_of(simulate(simulator, actor, seeds), len(seeds), quantities)
    ledger = batch.ledger
    assert ledger is not None
    lost = ledger.without[..., 0] - ledger.driven[..., 0]
    if isinstance(batch, _Noting):
        gap = batch.least_gaps()
    else:
        rate = options.simulation_frequency
        gap = _gaps(simulator.tracks, simulator.egos, ledger.relation, rate)
    kinds = ledger.relation[..., None] == np.arange(len(RELATIONS))
    in_both = (ledger.relation >= 0) & (ledger.without[..., 0] > 0) & (ledger.driven[..., 0] > 0)
    delay = (lost[..., None] * kinds).sum(axis=1)
    results |= {f"delay_{name}": delay[:, number] for number, name in enumerate(RELATIONS)}
    results |= {
        "delay": delay.sum(axis=1),
        "gap": np.where(gap > LONGEST_GAP, np.inf, gap),
        "helped": (in_both & (lost <= -MOVED)).sum(axis=1),
        "harmed": (in_both & (lost >= MOVED)).sum(axis=1),
    }
    return results


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
    before = buffers.before
    after = buffers.after
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

    window = int(LONGEST_GAP * frequency)
    gaps = np.zeros(len(egos), np.int64)
    arguments = tracks, egos.astype(np.int64), relation, window, gaps
    run_in_parts(encroachment, 1, len(egos), *arguments)
    return np.where(gaps > window, np.inf, gaps / frequency)


def cells_lost(table: Table) -> Float[np.ndarray, "state action"]:
    """Return the expected cells that others lose in each step of a gridworld by the ego, exactly.

    The rules give the same step without the ego, which has then arrived. The table has all states.
    Vehicles don't react to each other, so the sum over an episode is the delay to any later end.
    """
    mdp = table.mdp
    states = table.states
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
    """Return the cells that others lose in an episode of a policy on average, exactly.

    Args:
        table: The gridworld with all its states.
        chances: Action probabilities by state, or by time and state.
    """
    lost = cells_lost(table)
    mdp = replace(table.mdp, rewards=RewardPair(lost, lost))
    return evaluate_exactly(replace(table, mdp=mdp), chances).r_env


def summary(effects: Episodes) -> Row:
    """Return means with 95 % intervals: metres, brakings, shares, and the errors of Eq 4.2."""
    people = [
        name
        for user in ROAD_USERS
        if any(effects[f"signal_{name}"].any() for name in user.signals)
        for name in (f"{user.name}_delay", f"{user.name}_hit")
    ]
    row: Row = {"episodes": len(effects.ending)}
    row |= measures.summary(effects, (*_SUMMARISED, *people))
    sums = {name: int(effects[name].sum()) for name in COUNTS}

    def ratio(part: str, of: str) -> Row:
        return {f"{part}_of_{of}": sums[part] / sums[of] if sums[of] else np.nan}

    row |= {"charged": sums["charged"], "caused": sums["caused"]}
    row |= ratio("not_caused", "charged") | ratio("missed", "caused")
    row |= {"credited": sums["credited"]}
    return row | ratio("gained", "credited") | ratio("lost", "credited")


_SUMMARISED = (
    "r_env", "r_caused", "r_eq_4_2", "delay", *(f"delay_{name}" for name in RELATIONS), "braking",
    "gap_below_1_s", "gap_below_2_s", "helped", "harmed", "arrival", "collision", "at_fault",
)  # fmt: skip
