"""Many training runs ("lanes") in one compiled program: chunks, progress, stopping, resuming.

A learner is two pure functions: `initialise(numbers) -> (learnt, surroundings)` and
`update(numbers, learnt, surroundings) -> (learnt, surroundings, terms)`. `terms` are named scalars.
Arrays that all lanes share, such as demonstrations, are bound with `jax.tree_util.Partial`, so that
they are the program's input: a constant of that size would be compiled into it, anew for each set.
A lane whose terms or parameters are no longer finite keeps its last finite `learnt` and records
which term broke; the other lanes go on.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial
from jaxtyping import Array

from socialiq.errors import UserError
from socialiq.learners import checkpoint
from socialiq.learners.callbacks import Clock, Outside, Stopped, stop_line, stop_requests
from socialiq.learners.state import History, Lanes

# A parameter of this size is finite, but the next product of two layers is not.
_OVERFLOWS = 1e15

# Initialisation runs once: optimising its code takes longer than running it.
_COMPILE_FAST = {"xla_backend_optimization_level": 0}


def run(
    initialise: Callable[[Any], tuple[Any, Any]],
    update: Callable[[Any, Any, Any], tuple[Any, Any, dict[str, Any]]],
    numbers: Any,
    total: int,
    chunk: int,
    fingerprint: str,
    outside: Outside,
    before_chunk: Callable[[Lanes, int], Lanes] | None = None,
) -> tuple[Lanes, History]:
    """Train all lanes for `total` updates.

    Args:
        initialise: Makes one lane's state of its numbers.
        update: One gradient step of one lane.
        numbers: Pytree of the lanes' traced numbers, each with a leading lane axis.
        total: Updates of each lane.
        chunk: Updates between two looks at the outside world.
        fingerprint: Names the run; a checkpoint of another fingerprint is refused.
        outside: Progress, monitor, checkpoint.
        before_chunk: Called with the lanes and the number of updates done, to bring in outside
            experience; must depend on nothing else, or a resumed run would differ.

    Returns:
        The final lanes, and the history.

    Raises:
        Stopped: On Ctrl-C, after the chunk in progress.
        UserError: If a checkpoint can't be resumed.
    """
    initialise, update = _bound(initialise), _bound(update)
    begin = jax.jit(_start_all, compiler_options=_COMPILE_FAST)
    lanes, history = begin(initialise, numbers), History()
    if outside.resume:
        lanes, history = _resume(outside.checkpoint, fingerprint, lanes)
    advance = jax.jit(_advance_all, static_argnums=3, donate_argnums=2)
    names = term_names(update, numbers, lanes)
    done = history.updates[-1] if history.updates else 0
    clock = Clock(done, total, len(jax.tree.leaves(numbers)[0]))
    with stop_requests() as stop:
        while done < total:
            if before_chunk is not None:
                lanes = before_chunk(lanes, done)
            steps = min(chunk, total - done)
            lanes, terms = advance(update, numbers, lanes, steps)
            done += steps
            record = dict(zip(names, np.asarray(terms).T, strict=True))
            monitored = outside.monitor(lanes.learnt) if outside.monitor else {}
            history.add(done, record | monitored)
            if outside.on_report:
                failures = failure_lines(lanes, names, outside.lane_names)
                outside.on_report(clock.report(done, record, monitored, failures))
            if outside.checkpoint and (stop.is_set() or clock.minute_passed()):
                checkpoint.save(outside.checkpoint, fingerprint, lanes, history)
            if stop.is_set() and done < total:
                raise Stopped(stop_line(done, total, outside.checkpoint))
    return lanes, history


def term_names(update: Callable[..., Any], numbers: Any, lanes: Lanes) -> tuple[str, ...]:
    """Names of a learner's terms, in the order of `Lanes.failed_term`."""
    _, _, terms = jax.eval_shape(jax.vmap(update), numbers, lanes.learnt, lanes.surroundings)
    return _in_order(terms)


def failure_lines(
    lanes: Lanes, names: tuple[str, ...], lane_names: tuple[str, ...]
) -> tuple[str, ...]:
    """One line for each lane that stopped: which, when, which term."""
    causes = (*names, "parameters")
    lines = []
    for lane, (step, term) in enumerate(
        zip(np.asarray(lanes.failed_at), np.asarray(lanes.failed_term), strict=True)
    ):
        if step >= 0:
            name = lane_names[lane] if lane_names else f"lane {lane}"
            lines.append(
                f"{name} stopped at update {step}: {causes[term]} not finite; "
                "lower learning_rate, strength or prior_weight"
            )
    return tuple(lines)


def fingerprint(table: Any, *settings: Any) -> str:
    """SHA-256 of everything a run depends on; a checkpoint of another run is refused by it.

    Args:
        table: Pytree of the run's data.
        settings: Its settings: dataclasses of JSON-able fields, strings or numbers.
    """
    described = json.dumps(settings, sort_keys=True, default=dataclasses.asdict)
    digest = hashlib.sha256(described.encode())
    for column in jax.tree.leaves(table):
        digest.update(np.asarray(column).tobytes())
    return digest.hexdigest()


def _in_order(terms: Iterable[str]) -> tuple[str, ...]:
    """Names of terms, the loss last: if it is not finite, the term that broke it is named."""
    return tuple(sorted(terms, key=lambda name: (name == "loss", name)))


def _bound(function: Callable[..., Any]) -> Partial:
    """As a pytree of the arrays that are bound to it."""
    return function if isinstance(function, Partial) else Partial(function)


def _start_all(initialise: Partial, numbers: Any) -> Lanes:
    return jax.vmap(partial(_start, initialise))(numbers)


def _advance_all(update: Partial, numbers: Any, lanes: Lanes, steps: int) -> tuple[Lanes, Array]:
    """One chunk of all lanes."""
    one = partial(_advance, update, steps=steps)
    return jax.vmap(one)(numbers, lanes)


def _start(initialise: Callable[[Any], tuple[Any, Any]], numbers: Any) -> Lanes:
    learnt, surroundings = initialise(numbers)
    zero = jnp.zeros((), jnp.int32)
    return Lanes(learnt, surroundings, zero, zero - 1, zero - 1)


def _advance(
    update: Callable[..., Any], numbers: Any, lane: Lanes, *, steps: int
) -> tuple[Lanes, Array]:
    """One chunk of one lane; returns the mean of each term, NaN once the lane has broken."""

    def body(lane: Lanes, _: None) -> tuple[Lanes, Array]:
        learnt, surroundings, terms = update(numbers, lane.learnt, lane.surroundings)
        values = jnp.stack([terms[name] for name in _in_order(terms)])
        finite = jnp.append(jnp.isfinite(values), _all_finite(learnt))
        sound = lane.failed_at < 0
        breaks = sound & ~finite.all()
        after = Lanes(
            learnt=_choose(sound & finite.all(), learnt, lane.learnt),
            surroundings=surroundings,
            updates=lane.updates + 1,
            failed_at=jnp.where(breaks, lane.updates, lane.failed_at),
            failed_term=jnp.where(breaks, jnp.argmin(finite), lane.failed_term),
        )
        return after, jnp.where(sound, values, jnp.nan)

    lane, values = jax.lax.scan(body, lane, None, length=steps)
    return lane, values.mean(axis=0)


def _all_finite(tree: Any) -> Array:
    leaves = [leaf for leaf in jax.tree.leaves(tree) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    return jnp.stack([(jnp.abs(leaf) < _OVERFLOWS).all() for leaf in leaves]).all()


def _choose(condition: Array, yes: Any, no: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)


def _resume(path: Path | None, fingerprint: str, like: Lanes) -> tuple[Lanes, History]:
    if path is None:
        raise UserError("nothing to resume from: name the run's folder")
    lanes, updates, values = checkpoint.load(path, fingerprint, like)
    return lanes, History(updates, values)
