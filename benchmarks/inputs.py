"""Worth of a network's inputs, width and labels: networks that are fitted to labelled states.

    python benchmarks/inputs.py [--rounds 16] [--updates 10000] [--rows 512] [--seeds 0 1]

A dial that is trained over shifts visits their worlds; each state is labelled by rollouts of every
action in copies of the simulator. With history the network also reads each vehicle's change of
speed and heading since the decision before, and the ego's change of speed. Printed is the gain of
the chosen actions over the mean action on states that no fit has seen, with connected lanes too,
and that of the best ones. A GPU fits the networks where JAX has one; `--out` keeps the dials.
"""

import argparse
import dataclasses
import itertools
import multiprocessing
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax

from socialiq.cli.output import print_table
from socialiq.evaluation.branching import branched_returns, observed
from socialiq.evaluation.road_training import ITERATION
from socialiq.learners import policy_iteration
from socialiq.learners.dial.rows import stratified_angles
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.view import CHOICES, ROW, View
from socialiq.storage import packaged_results
from socialiq.worlds.highway.ego import POSITION_RANGE, SPEED_RANGE
from socialiq.worlds.highway.perception import EXITS
from socialiq.worlds.intersection.world import Intersection
from studies.compare_shifts.study import OWN

DIAL = "compare-shifts/randomised-200.safetensors"
TRAINING = find("compare-shifts").Config().training
BATCH, STEPS, HELD_OUT = 96, 25, 5
ROUND = BATCH * STEPS * len(TRAINING)  # states
KINDS = {
    "as it is": ("set", False, 64, 256),
    "with history": ("set", True, 64, 256),
    "closest approach": ("set_ahead", False, 64, 256),
    "encoder of 256": ("set", False, 256, 256),
    "width of 512": ("set", False, 64, 512),
    "width of 1,024": ("set", False, 64, 1024),
}
"""View, whether it reads the history, and widths of the encoder and of both hidden layers."""


def labelled(number):
    """Return observations, those before, returns and numbers of the worlds of one round."""
    jax.config.update("jax_platforms", "cpu")
    dial, rng = DialPolicy.load(packaged_results() / DIAL), np.random.default_rng(number)
    static = policy_iteration.with_network_of(ITERATION, dial)
    follow, columns = policy_iteration.greedy(dial), []
    for world, text in enumerate(TRAINING):
        batch = Intersection().shifted(text, OWN).batch(BATCH)
        batch.reset(rng.integers(2**63, size=BATCH, dtype=np.uint64))
        angles = stratified_angles(static, BATCH, rng)
        before = np.zeros_like(batch.observation)
        for _ in range(STEPS):
            observation = observed(batch, True, angles)
            returns = np.stack(branched_returns(batch, follow, True, angles), 1)
            columns.append((observation, before, returns.astype(np.float32), [world] * BATCH))
            random, explores = rng.integers(3, size=BATCH), rng.random(BATCH) < 0.1
            time, shown = batch.time, batch.observation
            batch.step(np.where(explores, random, follow(observation)))
            before = np.where((batch.time > time)[:, None], shown, 0.0).astype(np.float32)
    return [np.concatenate(column) for column in zip(*columns, strict=True)]


def inputs(observation, before, choice, with_history):
    """Return inputs of the other vehicles, their presence, and inputs of time and ego."""
    rows, old = (part.reshape(len(part), -1, ROW) for part in (observation[:, :-2], before))
    (ego, vehicles), (old_ego, old_vehicles) = ((part[:, 0], part[:, 1:]) for part in (rows, old))
    properties = CHOICES[choice]
    assert properties is not None
    view = View((), (), properties, rows[0].size)
    of_vehicles, of_ego = view.of_others(ego, vehicles), view.absolute(ego)
    if with_history:
        expected = old_vehicles[..., 1:3] + SPEED_RANGE / POSITION_RANGE * old_vehicles[..., 3:5]
        away = jnp.linalg.norm(vehicles[:, :, None, 1:3] - expected[:, None], axis=-1)
        away += 9.0 * (2.0 - (old_vehicles[:, None, :, 0] > 0) - (vehicles[:, :, None, 0] > 0))
        same = jnp.take_along_axis(old_vehicles, away.argmin(2)[..., None], axis=1)
        known = (away.min(2) < 0.06)[..., None]
        turned = same[..., 5:6] * vehicles[..., 6:] - same[..., 6:] * vehicles[..., 5:6]
        faster = 5.0 * (_speed(vehicles) - _speed(same))
        of_vehicles = jnp.concatenate([of_vehicles, known * faster, known * turned, known], -1)
        slower = 5.0 * (_speed(ego) - _speed(old_ego)) * old_ego[:, :1]
        of_ego = jnp.concatenate([of_ego, slower], axis=1)
    time = observation[:, -2:-1] == np.arange(Options().decisions * len(EXITS))
    return of_vehicles, vehicles[..., :1], jnp.concatenate([time, of_ego], axis=1)


def _speed(rows):
    return jnp.linalg.norm(rows[..., 3:5], axis=-1, keepdims=True)


def directions(observation):
    """Return (cos α, sin α) of the angles in degrees at the ends of observations."""
    radians = jnp.deg2rad(observation[:, -1:])
    return jnp.concatenate([jnp.cos(radians), jnp.sin(radians)], axis=1)


def outputs(layers, kind, observation, before):
    """Return both values of each action, of a network that pools the vehicles."""
    encoder, rest = layers
    of_vehicles, presence, of_ego = inputs(observation, before, *kind)
    for weight, bias in encoder:
        of_vehicles = jax.nn.relu(of_vehicles @ weight + bias)
    pooled = of_vehicles * presence
    columns = of_ego, pooled.sum(1), pooled.max(1), directions(observation)
    hidden = jnp.concatenate(columns, axis=-1)
    for weight, bias in rest[:-1]:
        hidden = jax.nn.relu(hidden @ weight + bias)
    return (hidden @ rest[-1][0] + rest[-1][1]).reshape(-1, 2, 3)


def loss(layers, kind, progress, observation, before, returns):
    """The loss of `policy_iteration.DialIteration` with a regression of two fifths."""
    values, direction = outputs(layers, kind, observation, before), directions(observation)
    score, gains = ((direction[:, None] @ pair)[:, 0] for pair in (values, returns))
    errors = jax.vmap(policy_iteration.regression_error, (1, 1, None))(values, returns, 0.05)
    gain, entropy = policy_iteration.expected_return(score, gains, 0.3)
    return jnp.where(progress < 0.4, errors.sum(0).mean(), -(gain + 0.01 * entropy).mean())


def fitted(states, kind, encoder, width, seed, updates, rows):
    """Return the running average of a network that is fitted to labelled states."""
    rng = np.random.default_rng(seed)

    def layers_of(*widths):
        shapes = itertools.pairwise(widths)
        return [
            (rng.normal(size=ends) * np.sqrt(2 / ends[0]), np.zeros(ends[1])) for ends in shapes
        ]

    examples = (jax.ShapeDtypeStruct((1, *part.shape[1:]), part.dtype) for part in states[:2])
    shapes = jax.eval_shape(lambda *parts: inputs(*parts, *kind), *examples)
    of_vehicles, of_ego = shapes[0].shape[-1], shapes[2].shape[-1]
    layers = (
        layers_of(of_vehicles, encoder, encoder),
        layers_of(of_ego + 2 * encoder + 2, width, width, 6),
    )
    layers = jax.tree.map(jnp.float32, layers)
    optimiser = optax.adam(optax.cosine_decay_schedule(1e-3, updates, 0.03))

    def update(states, carry, number):
        layers, state, average = carry
        key = jax.random.fold_in(jax.random.key(seed), number)
        drawn = jax.random.randint(key, (rows,), 0, len(states[0]))
        change = jax.grad(loss)(layers, kind, number / updates, *(part[drawn] for part in states))
        change, state = optimiser.update(change, state)
        layers = optax.apply_updates(layers, change)
        average = jax.tree.map(lambda a, b: a + 0.002 * (b - a), average, layers)
        return (layers, state, average), None

    @jax.jit
    def run(*states):
        start = layers, optimiser.init(layers), layers
        return jax.lax.scan(partial(update, states), start, jnp.arange(updates))[0][2]

    return run(*states)


def measured(layers, kind, fresh):
    """Return the mean gains over the mean action: chosen, with connected lanes, and best."""
    pairs, worlds = fresh[2], fresh[3]
    gains = np.asarray((directions(fresh[0])[:, None] @ pairs)[:, 0])
    gains = gains - gains.mean(axis=1, keepdims=True)
    values = jax.jit(partial(outputs, kind=kind))(layers, observation=fresh[0], before=fresh[1])
    chosen = np.asarray((directions(fresh[0])[:, None] @ values)[:, 0].argmax(axis=1))
    gain, connected = gains[np.arange(len(gains)), chosen], np.char.find(TRAINING, "connected") >= 0
    best, there = gains.max(axis=1), connected[worlds]
    return {
        "gain": float(gain.mean()),
        "connected": float(gain[there].mean()),
        "best": float(best.mean()),
        "best_connected": float(best[there].mean()),
    }


def as_dial(layers):
    """Return a network without history as a dial that drives behind the front end `OWN`."""
    dial = DialPolicy.load(packaged_results() / DIAL)
    (encoder, rest), view = layers, dial.turned.view
    assert isinstance(view, View)
    view = dataclasses.replace(view, **_parts(encoder))
    made_by = {"made_by": "benchmarks/inputs.py"}
    turned = dataclasses.replace(dial.turned, **_parts(rest), view=view, provenance=made_by)
    return dataclasses.replace(dial, turned=turned)


def _parts(layers):
    weights, biases = zip(*layers, strict=True)
    return {
        "weights": tuple(np.asarray(weight).T for weight in weights),
        "biases": tuple(np.asarray(bias) for bias in biases),
    }


def main() -> None:
    """Print the gains of each kind of network, number of rounds of labels, and seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name, default in {"updates": 10_000, "rows": 512, "processes": 1}.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    for name, defaults in {"rounds": [16], "seeds": [0, 1]}.items():
        parser.add_argument(f"--{name}", type=int, nargs="+", default=defaults)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    with multiprocessing.get_context("spawn").Pool(asked.processes) as pool:
        rounds = pool.map(labelled, range(HELD_OUT + max(asked.rounds)), chunksize=1)
    fresh, known = (
        [np.concatenate(column) for column in zip(*part, strict=True)]
        for part in (rounds[:HELD_OUT], rounds[HELD_OUT:])
    )
    table, numbers = [], (asked.updates, asked.rows)
    for count, (name, (*kind, encoder, width)), seed in itertools.product(
        asked.rounds, KINDS.items(), asked.seeds
    ):
        states = tuple(jnp.asarray(part[: count * ROUND]) for part in known[:3])
        layers = fitted(states, tuple(kind), encoder, width, seed, *numbers)
        row = {"network": name, "states": len(states[0]), "seed": seed}
        table.append(row | measured(layers, tuple(kind), fresh))
        if asked.out and [*kind, encoder] == ["set", False, 64]:
            asked.out.mkdir(parents=True, exist_ok=True)
            as_dial(layers).save(asked.out / f"{width}-{count}-{seed}.safetensors")
    print_table(table, f"{len(fresh[0]):,} states to measure")


if __name__ == "__main__":
    main()
