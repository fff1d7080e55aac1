"""Exact evaluation by class of road user: optima and dials over the social and the class angle."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from socialiq.evaluation.effects import Begun, caused_by_step, measure, measuring, summary
from socialiq.evaluation.exact import Readout, action_table
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.mdp.octant import OctantFront, octant_front
from socialiq.mdp.tabular import StateActionArray
from socialiq.nn.class_dial import ClassDial
from socialiq.social.angle import direction_of
from socialiq.types import Ending, Row
from socialiq.worlds.enumerate import Table
from socialiq.worlds.highway.world import RoadWorld

_TIE = 1e-6  # weight of the sum of all rewards; it costs no more than 1e-4 of a value


class ClassGround:
    """Gridworld with classes of road users: exact optima and evaluations in every direction.

    The table has all states of the world, with or without a clock.

    Raises:
        UserError: If the world has one class only.
    """

    def __init__(self, table: Table) -> None:
        self.part = table.reachable_part()
        self.horizon = table.world.horizon
        self.parts: tuple[StateActionArray, ...] = (
            table.world.with_parts().rewards(self.part.signals).parts
        )
        reachable = table.mdp.reachable()
        self._caused = [effect[reachable] for effect in caused_by_step(table).values()]

    def front(self) -> OctantFront:
        """Return all optima of the octant of directions."""
        return octant_front(self.part.mdp, self.parts, self.horizon)

    def optimum(
        self, angle: float, class_angle: float
    ) -> tuple[Float[np.ndarray, "time state action"], float]:
        """Return an optimal policy of a direction, and its value J*.

        Of policies that tie it is one with the largest sum of all three rewards.

        Args:
            angle: Social angle, degrees.
            class_angle: Angle between the classes of road users, degrees.

        Returns:
            Action probabilities by time and reachable state, and the mean score of an episode.
        """
        weights = np.array(direction_of(angle, class_angle).parts)
        mdp = self.part.mdp
        exact, tied = (
            horizon_optimum(mdp, np.tensordot(chosen, np.array(self.parts), 1), self.horizon)
            for chosen in (weights, weights + _TIE)
        )
        return tied.probabilities(mdp.n_actions), exact.value

    def measured(self, chances: Float[np.ndarray, "*time state action"]) -> Row:
        """Return the exact means of an episode of a policy.

        They are the three sums of rewards; the delay of vehicles in cells; the steps that
        pedestrians wait; and the shares of arrivals and collisions.
        """
        result = horizon_evaluation(self.part.mdp, chances, self.horizon)
        columns = ("r_env", "r_vehicle", "r_vulnerable", "vehicles_delayed", "pedestrians_waiting")
        tables = (*self.parts, *self._caused)
        row = {
            name: float((result.visits * table).sum())
            for name, table in zip(columns, tables, strict=True)
        }
        endings = {"arrival": Ending.ARRIVAL, "collision": Ending.COLLISION}
        return row | {name: float(result.endings[kind]) for name, kind in endings.items()}

    def optima(self, every: float) -> Iterator[Row]:
        """Yield the optimum of every direction of a grid of both angles, in degrees."""
        for class_angle, angle in itertools.product(_grid(every), repeat=2):
            chances, value = self.optimum(angle, class_angle)
            yield _named(angle, class_angle) | self.measured(chances) | {"value": value}

    def sweep(self, dial: ClassDial, every: float, readout: Readout = "greedy") -> Iterator[Row]:
        """Yield the policy of a dial, and its regret, at every direction of a grid.

        Args:
            dial: Dial of two angles; directions outside its range are left out.
            every: Step of both angles, degrees.
            readout: "greedy" for the best action, "soft" for the dial's probabilities.

        Yields:
            Both angles in degrees, the means of `measured`, and the `regret` in units of reward.
        """
        angles = [angle for angle in _grid(every) if dial.low <= angle <= dial.high]
        for class_angle in _grid(every):
            turned = dial.of_class(class_angle)
            for angle in angles:
                row = self.measured(action_table(turned.at(angle), self.part, readout))
                weights = direction_of(angle, class_angle).parts
                sums = [row[name] for name in ("r_env", "r_vehicle", "r_vulnerable")]
                regret = self.optimum(angle, class_angle)[1] - float(np.dot(weights, sums))
                yield _named(angle, class_angle) | row | {"regret": regret}


def driven(
    dial: ClassDial, world: RoadWorld, every: float, seeds: Sequence[int] | np.ndarray
) -> Iterator[Row]:
    """Yield what a dial causes at every direction of a grid, on the same episodes.

    Args:
        dial: Dial of two angles; directions outside its range are left out.
        world: Road with people on foot.
        every: Step of both angles, degrees.
        seeds: Seed of each episode.

    Yields:
        Both angles in degrees, and the means of `effects.summary` with 95 % intervals.
    """
    world = measuring(world)
    begun = Begun()
    for class_angle, angle in itertools.product(_grid(every), repeat=2):
        if dial.low <= angle <= dial.high:
            policy = dial.of_class(class_angle).at(angle)
            effects = measure(world, policy, seeds, begun, judging=False)
            yield _named(angle, class_angle) | summary(effects)


def _grid(every: float) -> Sequence[float]:
    return np.arange(0.0, 90.0 + 1e-9, every).tolist()


def _named(angle: float, class_angle: float) -> Row:
    return {"angle": angle, "class_angle": class_angle}
