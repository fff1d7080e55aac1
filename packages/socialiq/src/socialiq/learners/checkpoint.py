"""The resumable state of a run as one checked file: runs, history, and the run's fingerprint."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from socialiq.errors import UserError
from socialiq.learners.state import History, Runs
from socialiq.storage import load_arrays, save_arrays

SCHEMA_VERSION = 2


def save(path: Path, fingerprint: str, runs: Runs, history: History) -> None:
    """Write the state; a reader finds the previous state or this one, never a part.

    Raises:
        UserError: If the file can't be written.
    """
    leaves = enumerate(jax.tree.leaves(runs))
    arrays = {_name(number): _plain(leaf) for number, leaf in leaves}
    arrays |= {f"history_{name}": history.array(name) for name in history.values}
    arrays["history.updates"] = np.array(history.updates)
    save_arrays(path, "checkpoint", SCHEMA_VERSION, arrays, {"fingerprint": fingerprint})


def load(
    path: Path, fingerprint: str, like: Runs
) -> tuple[Runs, list[int], dict[str, list[np.ndarray]]]:
    """Read the state of the same run.

    Args:
        path: The file.
        fingerprint: Of the run that wants to go on.
        like: Freshly initialised runs, for the tree's shape.

    Returns:
        The runs, the updates done at each recorded chunk, and the recorded values.

    Raises:
        UserError: If the file is missing or damaged, or belongs to another run.
    """
    arrays, header = load_arrays(path, "checkpoint", SCHEMA_VERSION)
    if header.get("fingerprint") != fingerprint:
        raise UserError(
            f"{path} belongs to a run of other settings or data: repeat the run's own command"
        )
    leaves, shape = jax.tree.flatten(like)
    wanted = {_name(number): _plain(leaf) for number, leaf in enumerate(leaves)}
    history = {name: one for name, one in arrays.items() if name.startswith("history_")}
    done = arrays.get("history.updates", np.zeros((0, 0)))
    fits = all(
        name in arrays and (arrays[name].shape, arrays[name].dtype) == (leaf.shape, leaf.dtype)
        for name, leaf in wanted.items()
    )
    if not fits or done.ndim != 1 or any(len(one) != len(done) for one in history.values()):
        raise UserError(f"{path} is not the state of this run: remove it to start again")
    restored = []
    for name, leaf in zip(wanted, leaves, strict=True):
        value = jnp.asarray(arrays[name])
        restored.append(jax.random.wrap_key_data(value) if _is_key(leaf) else value)
    values = {name.removeprefix("history_"): list(history[name]) for name in sorted(history)}
    return jax.tree.unflatten(shape, restored), done.tolist(), values


def _name(number: int) -> str:
    return f"leaf_{number:03d}"


def _plain(leaf: jax.Array) -> np.ndarray:
    """Return a leaf as it is stored: a random key by its data."""
    return np.asarray(jax.random.key_data(leaf) if _is_key(leaf) else leaf)


def _is_key(leaf: jax.Array) -> bool:
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
