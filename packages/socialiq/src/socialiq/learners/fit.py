"""Training of many runs in one compiled program: chunks, progress, stopping, resuming.

A learner has two pure functions, `initialise(hyperparameters) -> (state, carry)` and
`update(hyperparameters, state, carry) -> (state, carry, terms)`; `learners.kernel.Learner` makes
them of a loss. `terms` are named scalars. Arrays that all runs share, such as demonstrations, are
leaves of the learner, so that they are the program's input: a constant of that size would be
compiled into it, for each set. A run whose terms or parameters are no longer finite keeps its
last finite state and records which term broke; all sound runs go on. Whether all is finite is
checked once a chunk, since a check at each update costs a tenth of a small network's time and a
fifth of the compilation; a run that broke is trained again over that chunk, with a check at each
update.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from socialiq.errors import UserError
from socialiq.learners.callbacks import Callbacks, Clock, Stopped, stop_requests
from socialiq.learners.state import History, Runs
from socialiq.storage import load_arrays, save_arrays

BeforeChunk = Callable[[Runs, int], Runs]
"""Called with the runs and the number of updates done, before each chunk."""

# A parameter of this size is finite, but the next product of two layers is not.
_OVERFLOWS = 1e15

CHECKPOINT_VERSION = 2

# Initialisation runs once: optimising its code takes longer than running it.
_COMPILE_FAST = {"xla_backend_optimization_level": 0}


def fit(
    learner: Any,
    hyperparameters: Any,
    total: int,
    chunk: int,
    fingerprint: str,
    callbacks: Callbacks,
    before_chunk: BeforeChunk | None = None,
) -> tuple[Runs, History, tuple[str, ...]]:
    """Train all runs of a learner for `total` updates; return runs, history and failures.

    Args:
        learner: The learner, with its two functions.
        hyperparameters: Arrays with a leading axis of runs.
        total: Updates of each run.
        chunk: Updates between two calls of the callbacks.
        fingerprint: Identity of data and settings; a checkpoint of another one is refused.
        callbacks: Progress, monitor, checkpoint.
        before_chunk: Adds experience from outside JAX. It must depend on its arguments alone, or a
            resumed run would differ.

    Returns:
        The runs after the last update, the record of each chunk, and one line for each run that
        stopped: which, when, which term, and what to lower.

    Raises:
        Stopped: On Ctrl-C, after the chunk in progress.
        UserError: If a checkpoint can't be resumed.
    """
    release_programs()
    begin = jax.jit(_start_all, compiler_options=_COMPILE_FAST)
    runs = begin(learner, hyperparameters)
    history = History()
    if callbacks.resume:
        if callbacks.checkpoint is None:
            raise UserError("nothing to resume from: name the run's folder")
        runs, history = load_checkpoint(callbacks.checkpoint, fingerprint, runs)
    done = history.updates[-1] if history.updates else 0
    steps = min(chunk, total - done) or chunk
    names = _chunk.eval_shape(learner, hyperparameters, runs, steps, _unchecked)[1].names
    clock = Clock(done, total, len(jax.tree.leaves(hyperparameters)[0]))
    with stop_requests() as stop:
        while done < total:
            if before_chunk is not None:
                runs = before_chunk(runs, done)
            steps = min(chunk, total - done)
            runs, terms = _advance(learner, hyperparameters, runs, steps)
            done += steps
            record = dict(zip(names, np.asarray(terms.values).T, strict=True))
            monitored = callbacks.monitor(runs.state) if callbacks.monitor else {}
            history.add(done, record | monitored)
            if callbacks.on_report:
                failures = failure_lines(runs, names, callbacks.run_names, hyperparameters)
                callbacks.on_report(clock.report(done, record, monitored, failures))
            due = stop.is_set() or (callbacks.keep and done == total)
            if callbacks.checkpoint and (due or clock.minute_passed()):
                save_checkpoint(callbacks.checkpoint, fingerprint, runs, history)
            if stop.is_set() and done < total:
                after = f"stopped after {done} of {total} updates"
                saved = ": go on with --resume" if callbacks.checkpoint else "; nothing was saved"
                raise Stopped(after + saved)
    return runs, history, failure_lines(runs, names, callbacks.run_names, hyperparameters)


def release_programs(most: int | None = None) -> None:
    """Let JAX forget its compiled programs if this process has more than `most` memory maps.

    Each program holds some. Linux grants a process `vm.max_map_count`, and a process that asks for
    one more crashes: after about a hundred trainings of different shapes. The default is a half.
    """
    try:
        if most is None:
            most = int(Path("/proc/sys/vm/max_map_count").read_text()) // 2
        if Path("/proc/self/maps").read_bytes().count(b"\n") > most:
            jax.clear_caches()
    except OSError:  # another system, without such a limit
        return


def failure_lines(
    runs: Runs, names: tuple[str, ...], run_names: tuple[str, ...], hyperparameters: Any
) -> tuple[str, ...]:
    """Return one line for each run that stopped: which, when, which term, and what to lower.

    Args:
        runs: All runs.
        names: Names of the terms, in the order of `Runs.failed_term`.
        run_names: Name of each run; empty: they are numbered.
        hyperparameters: Hyperparameters, which are read for their names alone.

    Returns:
        The lines, in the order of the runs; none if all runs are sound.
    """
    causes = *names, "parameters"
    lower = "learning_rate"
    weights = [name for name in ("strength", "prior_weight") if hasattr(hyperparameters, name)]
    if weights:
        lower = f"{', '.join([lower, *weights[:-1]])} or {weights[-1]}"
    failed = np.asarray(runs.failed_at)
    terms = np.asarray(runs.failed_term)
    return tuple(
        f"{run_names[run] if run_names else f'run {run}'} stopped at update {failed[run]}: "
        f"{causes[terms[run]]} not finite; lower {lower}"
        for run in np.flatnonzero(failed >= 0)
    )


def fingerprint(table: Any, *settings: Any) -> str:
    """SHA-256 of a run's data, a pytree, and its JSON-able settings, for checkpoints."""
    described = json.dumps(settings, sort_keys=True, default=dataclasses.asdict)
    digest = hashlib.sha256(described.encode())
    for column in jax.tree.leaves(table):
        digest.update(np.asarray(column).tobytes())
    return digest.hexdigest()


@partial(jax.tree_util.register_dataclass, data_fields=["values"], meta_fields=["names"])
@dataclasses.dataclass(frozen=True)
class _Terms:
    """Terms in the order of `Runs.failed_term`: the loss last, so that what broke it is named."""

    names: tuple[str, ...]
    values: Any  # an array, its shape, or what JAX puts in its place

    @staticmethod
    def of(terms: dict[str, Array]) -> _Terms:
        names = tuple(sorted(terms, key=lambda name: (name == "loss", name)))
        return _Terms(names, jnp.stack([terms[name] for name in names]))

    def mean(self) -> _Terms:
        return _Terms(self.names, self.values.mean(axis=0))


def _start_all(learner: Any, hyperparameters: Any) -> Runs:
    def start(hyperparameters: Any) -> Runs:
        state, carry = learner.initialise(hyperparameters)
        zero = jnp.zeros((), jnp.int32)
        return Runs(state, carry, zero, zero - 1, zero - 1)

    return jax.vmap(start)(hyperparameters)


def _advance(learner: Any, hyperparameters: Any, runs: Runs, steps: int) -> tuple[Runs, _Terms]:
    """Train all runs for one chunk; return them and the means of their terms, NaN for broken runs.

    The second program is compiled when a run breaks. Until then the runs as they were before the
    chunk stay in memory with those after it.
    """
    after, terms, finite = _chunk(learner, hyperparameters, runs, steps, _unchecked)
    stopped = np.asarray(runs.failed_at) >= 0
    breaks = ~stopped & ~np.asarray(finite)
    if breaks.any():
        checked = _chunk(learner, hyperparameters, runs, steps, _checked)
        after, terms = _choose_runs(breaks, checked, (after, terms))
    if stopped.any():
        missing = _Terms(terms.names, jnp.full_like(terms.values, jnp.nan))
        unchanged = runs._replace(updates=after.updates), missing
        after, terms = _choose_runs(stopped, unchanged, (after, terms))
    return after, terms


@partial(jax.jit, static_argnums=(3, 4))
def _chunk(
    learner: Any, hyperparameters: Any, runs: Runs, steps: int, advance: Callable[..., Any]
) -> Any:
    return jax.vmap(partial(advance, learner, steps=steps))(hyperparameters, runs)


def _unchecked(
    learner: Any, hyperparameters: Any, run: Runs, *, steps: int
) -> tuple[Runs, _Terms, Array]:
    """Train one run for one chunk; return the mean of each term, and whether all is finite."""

    def body(run: Runs, _: None) -> tuple[Runs, _Terms]:
        state, carry, terms = learner.update(hyperparameters, run.state, run.carry)
        after = run._replace(state=state, carry=carry, updates=run.updates + 1)
        return after, _Terms.of(terms)

    run, terms = jax.lax.scan(body, run, None, length=steps)
    means = terms.mean()
    return run, means, jnp.isfinite(means.values).all() & _all_finite(run.state)


def _checked(learner: Any, hyperparameters: Any, run: Runs, *, steps: int) -> tuple[Runs, _Terms]:
    """As `_unchecked`, but keep the last finite state; means are NaN once the run has broken."""

    def body(run: Runs, _: None) -> tuple[Runs, _Terms]:
        state, carry, terms = learner.update(hyperparameters, run.state, run.carry)
        ordered = _Terms.of(terms)
        finite = jnp.append(jnp.isfinite(ordered.values), _all_finite(state))
        sound = run.failed_at < 0
        breaks = sound & ~finite.all()
        after = Runs(
            state=_choose(sound & finite.all(), state, run.state),
            carry=carry,
            updates=run.updates + 1,
            failed_at=jnp.where(breaks, run.updates, run.failed_at),
            failed_term=jnp.where(breaks, jnp.argmin(finite), run.failed_term),
        )
        return after, _Terms(ordered.names, jnp.where(sound, ordered.values, jnp.nan))

    run, terms = jax.lax.scan(body, run, None, length=steps)
    return run, terms.mean()


def _all_finite(tree: Any) -> Array:
    leaves = [leaf for leaf in jax.tree.leaves(tree) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    return jnp.stack([(jnp.abs(leaf) < _OVERFLOWS).all() for leaf in leaves]).all()


def _choose(condition: Array, yes: Any, no: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)


def _choose_runs(condition: np.ndarray, yes: Any, no: Any) -> Any:
    return jax.vmap(_choose)(jnp.asarray(condition), yes, no)


def save_checkpoint(path: str | Path, fingerprint: str, runs: Runs, history: History) -> None:
    """Write the resumable state of a run; a reader finds the previous state or this one.

    Args:
        path: The file.
        fingerprint: Identity of data and settings.
        runs: The runs after a chunk.
        history: What was recorded until then.

    Raises:
        UserError: If the file can't be written.
    """
    arrays = {name: _plain(leaf) for name, leaf in _named_leaves(runs)}
    arrays |= {f"history_{name}": history.array(name) for name in history.values}
    arrays["history.updates"] = np.array(history.updates)
    save_arrays(path, "checkpoint", CHECKPOINT_VERSION, arrays, {"fingerprint": fingerprint})


def load_checkpoint(path: str | Path, fingerprint: str, like: Runs) -> tuple[Runs, History]:
    """Read the state of the same run.

    Args:
        path: The file.
        fingerprint: Identity of data and settings, which the file must have.
        like: Freshly initialised runs, whose form the state must have.

    Returns:
        The runs, and their history.

    Raises:
        UserError: If the file is missing or damaged, or belongs to another run.
    """
    arrays, header = load_arrays(path, "checkpoint", CHECKPOINT_VERSION)
    if header.get("fingerprint") != fingerprint:
        raise UserError(
            f"{path} belongs to a run of other settings or data: repeat the run's own command"
        )
    fresh = {name: _plain(leaf) for name, leaf in _named_leaves(like)}
    columns = {name: column for name, column in arrays.items() if name.startswith("history_")}
    updates = arrays.get("history.updates", np.zeros((0, 0)))
    fits = all(
        name in arrays and (arrays[name].shape, arrays[name].dtype) == (leaf.shape, leaf.dtype)
        for name, leaf in fresh.items()
    )
    lengths = [len(column) for column in columns.values()]
    if not fits or updates.ndim != 1 or any(length != len(updates) for length in lengths):
        raise UserError(f"{path} is not the state of this run: remove it to start again")
    restored = []
    for name, leaf in _named_leaves(like):
        value = jnp.asarray(arrays[name])
        restored.append(jax.random.wrap_key_data(value) if _is_key(leaf) else value)
    values = {name.removeprefix("history_"): list(columns[name]) for name in sorted(columns)}
    runs = jax.tree.unflatten(jax.tree.structure(like), restored)
    return runs, History(updates.tolist(), values)


def _named_leaves(runs: Runs) -> list[tuple[str, Array]]:
    return [(f"leaf_{number:03d}", leaf) for number, leaf in enumerate(jax.tree.leaves(runs))]


def _plain(leaf: Array) -> np.ndarray:
    """Return a leaf as it is stored: a random key by its data."""
    return np.asarray(jax.random.key_data(leaf) if _is_key(leaf) else leaf)


def _is_key(leaf: Array) -> bool:
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
