"""Effects of the ego on others: options of the measure, and its arrays, a row for each episode.

The same episode is driven without the ego, to the same end, so that the difference of both is the
ego's doing (difference reward; Wolpert and Tumer 2001). Kernels are in `core.effects`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.worlds.highway.options import AgentOptions, RoadOptions

CAUSED = "-caused"
"""Ending of the name of a world whose r_social is what the ego causes."""

SIGNALS = ("delay", "braking", "encounter")
"""Signals of a decision: metres that others lost, hard brakings of others that the ego caused, and
its closest predicted encounter, 0 to 1. The last decision has what follows the ego's episode."""

RELATIONS = "same_approach", "same_exit", "crossing"
"""Vehicles by their way: behind or ahead of the ego on its approach, merging with it, others."""

AfterTimeout = Literal["traffic", "removed"]


@dataclass(frozen=True)
class EffectOptions:
    """Options of a social reward of what the ego causes, in the place of Eq 4.2.

    Raises:
        UserError: If a value is not supported.
    """

    horizon: float = 0.0  # s from the reset, the end of both worlds; 0: 1.5 times the duration
    tow_after: float = 5.0  # s after which wrecks are removed, in both worlds; 0 leaves them
    # what an ego out of time becomes: a driver like the others, or nothing
    after_timeout: AfterTimeout = "traffic"
    delay_weight: float = -0.1  # of a metre that others lost
    braking_weight: float = -1.0  # of a hard braking of others
    encounter_weight: float = -2.0  # of a decision's closest encounter
    caused_collision_weight: float = -10.0  # of the ego's collision

    def __post_init__(self) -> None:
        one_of("after_timeout", self.after_timeout, get_args(AfterTimeout))
        for name in ("horizon", "tow_after"):
            if not (0 <= getattr(self, name) < math.inf):
                raise UserError(
                    f"{name} must be a number of seconds of at least 0, got {getattr(self, name)}"
                )
        for name in (*SIGNALS, "caused_collision"):
            if not math.isfinite(getattr(self, f"{name}_weight")):
                raise UserError(f"{name}_weight must be a finite number")

    def decisions(self, options: RoadOptions) -> int:
        """Return the number of decisions to the common end.

        Raises:
            UserError: If an episode may last longer.
        """
        seconds = self.horizon or 1.5 * options.duration
        if seconds < options.duration:
            raise UserError(
                f"horizon must be at least the duration of an episode, {options.duration:g} s, "
                f"got {seconds:g}"
            )
        return math.ceil(seconds * options.policy_frequency)

    @property
    def definition(self) -> dict[str, Any]:
        """Weights and units of the reward, as JSON."""
        names = (*SIGNALS, "caused_collision")
        units = {name: getattr(self, name) for name in ("horizon", "tow_after", "after_timeout")}
        return {name: getattr(self, f"{name}_weight") for name in names} | {"units": units}


EFFECTS = np.dtype(
    [
        ("decisions", np.int64),  # to the common end
        ("first_arrival", np.int64),  # identity of the first later vehicle; 0: none arrives
        ("tow_after", np.float64),  # s; infinite: never
        ("released", np.bool_),  # whether an ego out of time becomes a driver
        ("weights", np.float64, (len(SIGNALS) + 1,)),
    ],
    align=True,
)
"""Record of `EffectOptions` that the core reads."""


def check_agents(options: RoadOptions) -> None:
    """Refuse options with several agents.

    Raises:
        UserError: If the options are of several agents.
    """
    if isinstance(options, AgentOptions):
        raise UserError(
            "what one of several agents causes can't be measured: in an episode without it the "
            "policies of its partners would act otherwise, and the world doesn't know them: leave "
            "out reward=caused, or set agents=1"
        )


def record_of(effects: EffectOptions, options: RoadOptions) -> np.ndarray:
    """Return the options of effects as the record that the core reads.

    Args:
        effects: Options of the measure.
        options: Options of the road, for the common end and the later traffic.

    Returns:
        EFFECTS record in an array of one.

    Raises:
        UserError: If an episode may last longer than the horizon, or has several agents.
    """
    check_agents(options)
    record = np.zeros(1, EFFECTS)
    record["decisions"] = effects.decisions(options)
    initial = getattr(options, "initial_vehicle_count", None)
    record["first_arrival"] = 0 if initial is None else initial + 1
    record["tow_after"] = effects.tow_after or math.inf
    record["released"] = effects.after_timeout == "traffic"
    names = (*SIGNALS, "caused_collision")
    record["weights"] = [getattr(effects, f"{name}_weight") for name in names]
    return record


BEGIN, PREPARE, ACCOUNT, NEXT_ABSENT, ABSENT, REPEAT = range(6)
"""Commands of the core: after a reset, before a decision, after a decision; look ahead without the
ego, one decision or `AHEAD`, or (and above, plus the action) with an ego that repeats an action."""

AHEAD = 5  # decisions of a look ahead


class Ledger(NamedTuple):
    """Metres and brakings of others with and without the ego, a row for each episode.

    Vehicles are counted by identity, which is the same in both worlds.
    """

    arrivals: np.ndarray  # seed of the later traffic, uint64 (batch,)
    alone: np.ndarray  # metres and hard brakings without the ego, by decision, (batch, decision, 2)
    without: np.ndarray  # the same by vehicle to the common end, (batch, vehicle, 2)
    driven: np.ndarray  # with the ego, so far, (batch, vehicle, 2)
    relation: np.ndarray  # place in `RELATIONS`, -1 for none, int8 (batch, vehicle)
    wrecked: np.ndarray  # s since a crash, (batch, vehicle)
    signals: np.ndarray  # of the last decision, (batch, signal)
    # of a look ahead, by vehicle: speed after a decision, m/s, and metres in `AHEAD` decisions; NaN
    # if it is not there, (batch, vehicle, 2)
    ahead: np.ndarray

    @staticmethod
    def of(record: np.ndarray, records: int, size: int) -> Ledger:
        """Return an empty ledger.

        Args:
            record: EFFECTS record in an array of one.
            records: Number of records of vehicles on the road.
            size: Number of episodes.
        """
        decisions = int(record["decisions"][0])
        first = int(record["first_arrival"][0])
        vehicles = max(first + decisions + 1 if first else 0, records)
        return Ledger(
            arrivals=np.zeros(size, np.uint64),
            alone=np.zeros((size, decisions, 2)),
            without=np.zeros((size, vehicles, 2)),
            driven=np.zeros((size, vehicles, 2)),
            relation=np.zeros((size, vehicles), np.int8),
            wrecked=np.zeros((size, vehicles)),
            signals=np.zeros((size, len(SIGNALS))),
            ahead=np.zeros((size, vehicles, 2)),
        )
