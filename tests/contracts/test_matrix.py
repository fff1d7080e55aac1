"""Every capability in every world: it runs, or it is refused for a reason in the world's nature."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.fleet import drive
from socialiq.evaluation.simulate import play
from socialiq.worlds import catalogue, grammar

CAPABILITIES = {
    "plain": "",
    "caused": "reward=caused",
    "late": "late",
    "noise": "noise=1",
    "sight": "sight=30",
    "wet": "wet",
    "front end": "front_end=[latency=1,track=3]",
    "people": "people=0.1",
    "cyclists": "cyclists=0.1",
    "agents": "agents=2",
    "continuous": "control=continuous",
    "steering": "control=steering",
    "exit": "exit=right",
    "left hand": "left_hand=true",
    "along the route": "observation=route",
}
"""Words of the grammar by capability."""

NATURE = (
    *(reason for *_, reason in catalogue.NATURE),
    "the ego can't reach 'right' by acceleration alone",
    "can't follow a way with bends by acceleration alone",
    "it has no bicycle lanes",
    "the policies of its partners would act otherwise",
)
"""Reasons that lie in the nature of a world."""

CELLS = [
    (world, pair)
    for world in catalogue.NAMES
    for pair in itertools.combinations(CAPABILITIES, 2)
    if pair != ("continuous", "steering")  # two values of one key
]


def _drive(world, seeds):
    """Drive a batch of any world with its first rule, or idle."""
    batch = world.batch(len(seeds))
    if getattr(world, "agents", 1) > 1:
        return drive(batch, [world.driver(world.drivers[0], 0)], seeds).ending
    policy = world.driver(world.drivers[0], 0)
    return np.concatenate([step.made.ending for step in play(batch, policy, seeds)])


@pytest.mark.parametrize(("name", "pair"), CELLS, ids=lambda value: str(value))
def test_pair_of_capabilities_runs_or_is_refused_for_a_reason(name, pair):
    text = ",".join(filter(None, [name, *(CAPABILITIES[word] for word in pair)]))
    try:
        world = grammar.build(text)
    except UserError as error:
        message = str(error)
        assert any(reason in message for reason in NATURE), message
        return
    if world.is_exact:
        return
    assert len(_drive(world, [0, 1]))
