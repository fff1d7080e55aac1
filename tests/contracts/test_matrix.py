"""Every capability in every world: it runs, or it is refused for a reason in the world's nature."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.fleet import drive
from socialiq.evaluation.shield import Shield
from socialiq.evaluation.simulate import Watched, play
from socialiq.worlds import catalogue, grammar
from socialiq.worlds.world import ConstantPolicy

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


def _built(name, capability, *more):
    """Return a world with a capability and further words; None where its nature has no such."""
    text = ",".join(filter(None, [name, CAPABILITIES[capability], *more]))
    try:
        return grammar.build(text)
    except UserError as error:
        assert any(reason in str(error) for reason in NATURE), str(error)
        return None


def _steady(world):
    """Return the action that changes least, and another one."""
    if world.action_size:
        steady = np.zeros(world.action_size, np.float32)
        return steady, np.full(world.action_size, -1.0, np.float32)
    return np.array(1), np.array(0)


class _Steadily(ConstantPolicy):
    """Policy that takes one action in every row of a batch."""

    def choose(self, observation, _deterministic, /):
        assert observation.shape[-1] == getattr(self, "n_features", observation.shape[-1])
        return np.broadcast_to(self.action, (len(observation), *self.action.shape))


SINGLE = [(name, capability) for name in catalogue.NAMES for capability in CAPABILITIES]


@pytest.mark.parametrize(("name", "capability"), SINGLE)
def test_the_clock_is_the_last_feature_of_every_batch(name, capability):
    """A policy of one feature more observes the time; one of as many observes the plain rows."""
    world = _built(name, capability)
    if world is None:
        return
    batch = world.batch(3)
    batch.reset(np.arange(3))
    action, _ = _steady(world)
    plain, timed = (ConstantPolicy(action) for _ in range(2))
    plain.n_features = world.n_features
    timed.n_features = world.n_features + 1
    late = world.front_end.latency if getattr(world, "front_end", None) else 0
    agents = getattr(batch, "shape", (3,))
    actions = np.broadcast_to(action, (*agents, *action.shape)).copy()
    running = np.ones(3, bool)
    for decision in range(3):
        rows = batch.seen_by(timed)
        np.testing.assert_array_equal(rows[..., :-1], batch.seen_by(plain))
        assert (rows[running][..., -1] == decision + late).all()
        ending = batch.step(actions, auto_reset=False, rows=running).ending
        running = running & (ending.reshape(3, -1) == 0).all(axis=1)
    assert running.any()


@pytest.mark.parametrize(("name", "capability"), SINGLE)
def test_a_fallback_decides_in_every_batch_where_the_note_is_true(name, capability):
    world = _built(name, capability)
    if world is None or getattr(world, "agents", 1) > 1:  # agents have policies each
        return
    own, instead = _steady(world)
    notes = []

    def note(rows):
        notes.append(np.arange(len(rows)) % 2 == len(notes) % 2)
        return notes[-1]

    policy, fallback = (_Steadily(action) for action in (own, instead))
    policy.n_features = world.n_features + 1
    fallback.n_features = world.n_features
    watched = Watched(policy, note, fallback)
    steps = [step.action for step in play(world.batch(4), watched, range(4))]
    for actions, noted in zip(steps, notes, strict=True):
        expected = np.where(noted.reshape(4, *[1] * instead.ndim), instead, own)
        np.testing.assert_array_equal(actions, expected)


NO_SHIELD = (
    "needs the seconds to a person",  # gridworlds have steps and cells
    "no one walks here",
    "leave agents out",
)
"""Reasons why a world has no shield."""


@pytest.mark.parametrize(("name", "capability"), SINGLE)
def test_a_shield_brakes_in_every_world_where_people_walk(name, capability):
    """It brakes exactly where an ego is near a person, whatever the numbers of the actions."""
    walks = name not in catalogue.GRIDS
    if walks:
        plain = "plain" if capability == "people" else capability
        world = _built(name, plain, "people=0.9")
    else:
        world = _built(name, capability)
    if world is None:
        return
    batch = world.batch(48)
    own, _ = _steady(world)
    if not walks or world.agents > 1:
        with pytest.raises(UserError) as refused:
            Shield(_Steadily(own), batch, 8.0)
        assert any(reason in str(refused.value) for reason in NO_SHIELD)
        return
    policy = Shield(_Steadily(own), batch, 8.0)
    braking = -1.0 if world.action_size else world.scene.actions.index("slower")
    count = 0
    for step in play(batch, policy, range(48)):
        chosen = step.action[:, 0] if world.action_size else step.action
        near = policy.noted & step.running
        assert (chosen[near] == braking).all()
        assert (chosen[step.running & ~near] == own.ravel()[0]).all()
        count += near.sum()
    assert count > 0
