"""Worth of a network's inputs and width: networks that are fitted to the same labelled states.

    python benchmarks/inputs.py

A dial that is trained over shifts visits their worlds; each state is labelled by rollouts of every
action in copies of the simulator. With history the network also reads each vehicle's change of
speed and heading since the decision before, and the ego's change of speed. Printed is the gain of
the chosen actions over the mean action on states that no fit has seen, and that of the best ones.
"""

import itertools

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
from socialiq.worlds.intersection.perception import DECISIONS, EXITS, PER_SECOND
from socialiq.worlds.intersection.world import Intersection
from studies.compare_shifts.study import OWN, TRAINING

DIAL = "compare-shifts/randomised-200.safetensors"
BATCH, STEPS, ROUNDS, HELD_OUT = 96, 25, 16, 5
UPDATES, ROWS, SEEDS = 10_000, 512, (0, 1)
KINDS = {
    "as it is": ("set", False, 256),
    "with history": ("set", True, 256),
    "closest approach": ("set_ahead", False, 256),
    "twice as wide": ("set", False, 512),
}
"""View, whether it reads the history, and width of both hidden layers."""


def labelled(dial, rng):
    """Return observations with their angles, those before, and labels of one round."""
    static = policy_iteration.with_network_of(ITERATION, dial)
    follow, columns = policy_iteration.greedy(dial), []
    for text in TRAINING:
        batch = Intersection().shifted(text, OWN).batch(BATCH)
        batch.reset(rng.integers(2**63, size=BATCH, dtype=np.uint64))
        angles = stratified_angles(static, BATCH, rng)
        before = np.zeros_like(batch.observation)
        for _ in range(STEPS):
            observation = observed(batch, True, angles)
            returns = np.stack(branched_returns(batch, follow, True, angles), 1)
            columns.append((observation, before, returns.astype(np.float32)))
            random, explores = rng.integers(3, size=BATCH), rng.random(BATCH) < 0.1
            time, shown = batch.time, batch.observation
            batch.step(np.where(explores, random, follow(observation)))
            before = np.where((batch.time > time)[:, None], shown, 0.0)
    return columns


def inputs(observation, before, choice, with_history):
    """Return inputs of the other vehicles, their presence, and inputs of ego, time and angle."""
    rows, old = (part.reshape(len(part), -1, ROW) for part in (observation[:, :-2], before))
    (ego, vehicles), (old_ego, old_vehicles) = ((part[:, 0], part[:, 1:]) for part in (rows, old))
    properties = CHOICES[choice]
    assert properties is not None
    view = View((), (), properties, rows[0].size)
    of_vehicles, of_ego = view.of_others(ego, vehicles), view.absolute(ego)
    if with_history:
        expected = old_vehicles[..., 1:3] + PER_SECOND * old_vehicles[..., 3:5]
        away = np.linalg.norm(vehicles[:, :, None, 1:3] - expected[:, None], axis=-1)
        away += 9.0 * (2.0 - (old_vehicles[:, None, :, 0] > 0) - (vehicles[:, :, None, 0] > 0))
        same = np.take_along_axis(old_vehicles, away.argmin(2)[..., None], axis=1)
        known = (away.min(2) < 0.06)[..., None]
        turned = same[..., 5:6] * vehicles[..., 6:] - same[..., 6:] * vehicles[..., 5:6]
        faster = 5.0 * (_speed(vehicles) - _speed(same))
        of_vehicles = np.concatenate([of_vehicles, known * faster, known * turned, known], -1)
        of_ego = np.concatenate([of_ego, 5.0 * (_speed(ego) - _speed(old_ego)) * old_ego[:, :1]], 1)
    time = observation[:, -2:-1] == np.arange(DECISIONS * len(EXITS))
    of_ego = np.concatenate([of_ego, time, directions(observation)], axis=1)
    return of_vehicles.astype(np.float32), vehicles[..., :1], of_ego.astype(np.float32)


def _speed(rows):
    return np.linalg.norm(rows[..., 3:5], axis=-1, keepdims=True)


def directions(observation):
    """Return (cos α, sin α) of the angles in degrees at the ends of observations."""
    radians = np.deg2rad(observation[:, -1:])
    return np.concatenate([np.cos(radians), np.sin(radians)], axis=1)


def outputs(layers, of_vehicles, presence, of_ego):
    """Return both values of each action, of a network that pools the vehicles."""
    encoder, rest = layers
    for weight, bias in encoder:
        of_vehicles = jax.nn.relu(of_vehicles @ weight + bias)
    pooled = of_vehicles * presence
    hidden = jnp.concatenate([of_ego, pooled.sum(1), pooled.max(1)], axis=-1)
    for weight, bias in rest[:-1]:
        hidden = jax.nn.relu(hidden @ weight + bias)
    return (hidden @ rest[-1][0] + rest[-1][1]).reshape(-1, 2, 3)


def loss(layers, rows, returns, progress):
    """The loss of `policy_iteration.DialIteration` with a regression of two fifths."""
    values, direction = outputs(layers, *rows), rows[2][:, None, -2:]
    score, gains = ((direction @ pair)[:, 0] for pair in (values, returns))
    errors = jax.vmap(policy_iteration.regression_error, (1, 1, None))(values, returns, 0.05)
    gain, entropy = policy_iteration.expected_return(score, gains, 0.3)
    return jnp.where(progress < 0.4, errors.sum(0).mean(), -(gain + 0.01 * entropy).mean())


def fitted(rows, returns, width, seed):
    """Return the running average of a network that is fitted to labelled states."""
    rng = np.random.default_rng(seed)

    def layers_of(*widths):
        shapes = itertools.pairwise(widths)
        return [
            (rng.normal(size=ends) * np.sqrt(2 / ends[0]), np.zeros(ends[1])) for ends in shapes
        ]

    layers = (
        layers_of(rows[0].shape[-1], 64, 64),
        layers_of(rows[2].shape[1] + 128, width, width, 6),
    )
    layers = jax.tree.map(jnp.float32, layers)
    optimiser = optax.adam(optax.cosine_decay_schedule(1e-3, UPDATES, 0.03))

    @jax.jit
    def update(layers, state, average, batch, progress):
        change, state = optimiser.update(jax.grad(loss)(layers, *batch, progress), state)
        layers = optax.apply_updates(layers, change)
        return layers, state, jax.tree.map(lambda a, b: a + 0.002 * (b - a), average, layers)

    state, average = optimiser.init(layers), layers
    for number in range(UPDATES):
        drawn = rng.integers(len(returns), size=ROWS)
        batch = tuple(part[drawn] for part in rows), returns[drawn]
        layers, state, average = update(layers, state, average, batch, number / UPDATES)
    return average


def main() -> None:
    """Print the gain of each kind of network and seed, beside that of the best actions."""
    dial, rng = DialPolicy.load(packaged_results() / DIAL), np.random.default_rng(0)
    rounds = [labelled(dial, rng) for _ in range(ROUNDS + HELD_OUT)]
    known, fresh = (
        [np.concatenate(column) for column in zip(*itertools.chain(*part), strict=True)]
        for part in (rounds[:ROUNDS], rounds[ROUNDS:])
    )
    gains = (directions(fresh[0])[:, None] @ fresh[2])[:, 0]
    gains, table = gains - gains.mean(axis=1, keepdims=True), []
    for (name, (*kind, width)), seed in itertools.product(KINDS.items(), SEEDS):
        layers = fitted(inputs(*known[:2], *kind), known[2], width, seed)
        rows = inputs(*fresh[:2], *kind)
        values = np.asarray(jax.jit(outputs)(layers, *rows))
        chosen = (rows[2][:, None, -2:] @ values)[:, 0].argmax(axis=1)
        gain = gains[np.arange(len(gains)), chosen].mean()
        table.append({"network": name, "seed": seed, "gain": gain, "best": gains.max(1).mean()})
    print_table(table, f"{len(known[0]):,} states to fit, {len(gains):,} to measure")


if __name__ == "__main__":
    main()
