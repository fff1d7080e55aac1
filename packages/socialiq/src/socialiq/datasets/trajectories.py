"""Demonstrations from trajectories in the form of the `imitation` library, which is not needed.

A trajectory has `obs` (steps + 1), `acts` (steps) and `terminal`, and may have `rews` and `infos`
(steps). In `imitation`, `terminal` is also set where a time limit cut the episode. To a learner
that is not a terminal state, so it must be marked: by `info["TimeLimit.truncated"]`, which
Stable-Baselines3's vector environments set; by our worlds' `info["ending"]`; or by `time_limit`.
"""

import itertools
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.datasets.arrays import Bounds, features_of, of_steps, pair_of, plain_actions
from socialiq.datasets.step_files import MOST_BYTES, format_of, read_npz, source_of
from socialiq.datasets.step_tables import Layout, read_csv, read_parquet
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.reading import open_file, sha256_of, sha256_of_file
from socialiq.types import Ending


def of_trajectories(
    trajectories: Iterable[Any],
    *,
    n_actions: int = 0,
    bounds: Bounds | None = None,
    modes: str | Sequence[str] = "demonstrator",
    social: str = "",
    time_limit: int = 0,
    flatten: bool = False,
    source: dict[str, Any] | None = None,
) -> Demonstrations:
    """Make a table from trajectories: objects with the attributes above, or dicts.

    The reward pair of a step is `info["reward_pair"]`; else `rews` of shape (steps, 2); else, where
    `social` says so, `rews` is r_env.

    Args:
        trajectories: One for each episode.
        n_actions: Number of actions of the world; 0 for continuous ones.
        bounds: As of `arrays.of_steps`.
        modes: Name of the demonstrator, or one name for each trajectory.
        social: "none" if `rews` of one number a step is r_env, and r_social is 0.
        time_limit: A terminal trajectory of this many steps was cut by the clock; 0 for no limit.
        flatten: Whether observations of more axes (images) are flattened to one.
        source: Provenance of the data.

    Raises:
        UserError: If a trajectory is wrong; the line names it.
    """
    listed = list(trajectories)
    if not listed:
        raise UserError("no trajectories: pass at least one")
    labels = [modes] * len(listed) if isinstance(modes, str) else list(modes)
    if len(labels) != len(listed):
        raise UserError(f"{len(labels)} modes for {len(listed)} trajectories: name one for each")
    tables = []
    for number, trajectory in enumerate(listed):
        try:
            tables.append(_columns(trajectory, social, time_limit, flatten))
        except UserError as error:
            raise UserError(f"trajectory {number}: {error}") from error
    widths = {table["observation"].shape[1] for table in tables}
    if len(widths) > 1:
        raise UserError(f"trajectories differ in features ({', '.join(map(str, sorted(widths)))})")
    if len({table["action"].shape[1:] for table in tables}) > 1:
        raise UserError("trajectories differ in actions: give all of them the same kind and size")
    lengths = [len(table["action"]) for table in tables]
    names = tuple(dict.fromkeys(labels))
    columns: dict[str, Any] = {
        name: np.concatenate([table[name] for table in tables]) for name in tables[0]
    }
    columns["episode"] = np.repeat(np.arange(len(tables)), lengths)
    columns["mode"] = np.repeat([names.index(name) for name in labels], lengths)
    return of_steps(
        **columns,
        mode_names=names,
        n_actions=n_actions,
        bounds=bounds,
        source=source or {"made_by": "of_trajectories"},
    )


def read_trajectories(path: Path, *, mode: str = "demonstrator", **options: Any) -> Demonstrations:
    """Read trajectories: `imitation`'s archive (.npz) or folder, or one row for each step.

    A .csv or .parquet has the columns of `ROWS`: `trajectory` numbers the trajectories, `terminal`
    is set in the last row of one that has an end. A folder is of Hugging Face `datasets`, as
    `imitation` 1.0 saves it. Further options are those of `of_trajectories`.

    Raises:
        UserError: If the file is missing or damaged, or an array or column is missing or wrong.
    """
    if path.is_dir():
        return _read_folder(path, modes=mode, **options)
    kind = format_of(path)
    source = source_of(path) if path.is_file() else {}
    if kind == ".npz":
        content = read_npz(path, ("obs", "acts", "rews", "terminal", "indices"))
    else:
        content = read_csv(path, ROWS) if kind == ".csv" else read_parquet(path, layout=ROWS)[0]
    try:
        if kind == ".npz":
            trajectories = condensed(content)
        else:
            trajectories = _by_trajectory(ROWS.arrays_of(content, str(path)))
        return of_trajectories(trajectories, modes=mode, source=source, **options)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error


ROWS = Layout(
    vectors=("obs", "next_obs"),
    action="acts",
    scalars={
        "rews": "number",
        "r_env": "number",
        "r_social": "number",
        "terminal": "flag",
        "trajectory": "integer",
    },
    reward="rews",
    required=("obs_0", "next_obs_0", "terminal", "trajectory"),
)
"""Columns of a table of trajectories, under the names of `imitation`."""


def _by_trajectory(rows: Mapping[str, np.ndarray]) -> list[dict[str, Any]]:
    """Return the trajectories of a table, whose rows must follow each other."""
    number = rows["trajectory"]
    terminal = rows["terminal"]
    cuts = np.flatnonzero(np.diff(number)) + 1
    if len(np.unique(number)) != len(cuts) + 1:
        raise UserError("the rows of a trajectory are not adjacent: sort by trajectory")
    inner = np.setdiff1d(np.arange(1, len(number)), cuts)
    wrong = inner[(rows["next_obs"][inner - 1] != rows["obs"][inner]).any(axis=1)]
    if len(wrong):
        raise UserError(
            f"row {wrong[0]} does not begin where the row before it ends: its obs must be the "
            "next_obs of that row"
        )
    if terminal[inner - 1].any():
        raise UserError("terminal is set before a trajectory's last row: set it in the last alone")
    edges = [0, *cuts.tolist(), len(number)]
    return [
        {
            "obs": np.concatenate([rows["obs"][begin:end], rows["next_obs"][end - 1 : end]]),
            "acts": rows["acts"][begin:end],
            "rews": rows["rews"][begin:end],
            "terminal": terminal[end - 1],
        }
        for begin, end in itertools.pairwise(edges)
    ]


_PARTS = "data-*.arrow"  # files of a folder of `datasets`, in the order of their names
_COLUMNS = ("obs", "acts", "terminal", "rews", "infos")
_FACTS = ("reward_pair", "ending", "TimeLimit.truncated")  # of a step's info


def _read_folder(folder: Path, **options: Any) -> Demonstrations:
    """Read a folder of `datasets`, with one row for each trajectory."""
    parts = sorted(folder.glob(_PARTS))
    if not parts:
        raise UserError(
            f"{folder} is a folder without {_PARTS}: name a file, or a folder that imitation saved"
        )
    if sum(part.stat().st_size for part in parts) > MOST_BYTES:
        raise UserError(f"{folder} holds more than {MOST_BYTES:,} bytes: split it")
    ipc = optional("pyarrow.ipc", "parquet", "folders of trajectories")
    listed: list[dict[str, Any]] = []
    for part in parts:
        try:
            with open_file(part) as file, ipc.open_stream(file) as stream:
                listed += [row for batch in stream for row in _rows_of(batch, part)]
        except UserError:
            raise
        # pyarrow's errors are these, or descend from them.
        except (OSError, ValueError, KeyError, TypeError, RuntimeError, MemoryError) as error:
            raise UserError(f"{part} is damaged or no Arrow stream: save it again") from error
    sha256 = sha256_of("".join(f"{sha256_of_file(part)}\n" for part in parts))
    source = {"made_by": "socialiq data", "file": folder.name, "sha256": sha256}
    try:
        return of_trajectories(listed, source=source, **options)
    except UserError as error:
        raise UserError(f"{folder}: {error}") from error


def _rows_of(batch: Any, part: Path) -> list[dict[str, Any]]:
    """Return the trajectories of a batch of Arrow; its columns of other names are not read."""
    if batch.nbytes > MOST_BYTES:
        raise UserError(f"{part} has a batch of more than {MOST_BYTES:,} bytes: split it")
    names = [name for name in _COLUMNS if name in batch.schema.names]
    try:
        return [
            {name: _cell(name, batch.column(name)[number]) for name in names}
            for number in range(batch.num_rows)
        ]
    except UserError as error:
        raise UserError(f"{part}: {error}") from error


def _cell(name: str, cell: Any) -> Any:
    """Return what one trajectory has in a column; None of an empty cell."""
    if not cell.is_valid or name == "terminal":
        return cell.as_py()
    if not hasattr(cell, "values"):
        kind = one_line(str(cell.type), 40)
        raise UserError(f"{name} is {kind}: save a list for each trajectory")
    if name == "infos":
        return [_facts(text) for text in cell.as_py()] or None
    return _numbers(name, cell.values)


def _numbers(name: str, values: Any) -> np.ndarray:
    """Return nested lists of Arrow as one array; every list of a level has the same length."""
    shape = [len(values)]
    while hasattr(values, "flatten") and hasattr(values.type, "value_type"):
        lengths = np.asarray(values.value_lengths())
        values = values.flatten()
        shape.append(int(lengths.max(initial=0)))
        if len(np.unique(lengths)) > 1:
            raise UserError(f"{name} has rows of several lengths: give every step the same shape")
    array = values.to_numpy(zero_copy_only=False)
    if values.null_count or array.dtype.kind not in "fiub":
        kind = one_line(str(values.type), 40)
        raise UserError(f"{name} holds {kind} or empty cells: save it as numbers")
    return array.reshape(shape)


def _facts(text: Any) -> dict[str, Any]:
    """Return what a step's info says as plain JSON; objects in it are never made."""
    try:
        info = json.loads(text) if isinstance(text, str) else {}
    except (ValueError, RecursionError) as error:
        raise UserError(
            "infos holds a text that is no JSON: save the trajectories again"
        ) from error
    facts = {name: info[name] for name in _FACTS if isinstance(info, dict) and name in info}
    pair = facts.get("reward_pair", [0.0, 0.0])
    if not isinstance(pair, list) or not all(type(value) in (int, float) for value in pair):
        raise UserError(
            "reward_pair in infos is an object, which is not made: save it as a list of two numbers"
        )
    return facts


def condensed(arrays: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the trajectories of `imitation`'s older archive, which has them end to end.

    `indices` has the first step of each but the first. The archive's `infos` are pickled and never
    read, so its time limits are known by `time_limit` alone.

    Raises:
        UserError: If an array is missing, or they don't fit each other.
    """
    missing = [name for name in ("obs", "acts", "terminal", "indices") if name not in arrays]
    if missing:
        raise UserError(f"no {', '.join(missing)}: save obs, acts, terminal and indices")
    terminal = np.asarray(arrays["terminal"])
    acts = np.asarray(arrays["acts"])
    obs = np.asarray(arrays["obs"])
    rews = arrays.get("rews")
    cuts = np.asarray(arrays["indices"])
    fits = cuts.ndim == 1 and terminal.ndim == 1 and min(acts.ndim, obs.ndim) > 0
    fits = fits and (cuts.dtype.kind in "iu" or not len(cuts)) and len(cuts) == len(terminal) - 1
    edges = [0, *cuts.tolist(), len(acts)] if fits else []
    if not fits or any(later <= sooner for sooner, later in itertools.pairwise(edges)):
        raise UserError(
            "indices must hold the first step of each trajectory but the first, rising, and "
            "terminal one boolean for each trajectory"
        )
    if len(obs) != len(acts) + len(terminal) or (rews is not None and len(rews) != len(acts)):
        raise UserError(
            f"obs has {len(obs)} rows for {len(acts)} actions in {len(terminal)} trajectories: "
            "it needs one more than actions in each, and rews as many as actions"
        )
    return [
        {
            "obs": obs[begin + number : end + number + 1],
            "acts": acts[begin:end],
            "rews": None if rews is None else rews[begin:end],
            "terminal": terminal[number],
        }
        for number, (begin, end) in enumerate(itertools.pairwise(edges))
    ]


def _columns(trajectory: Any, social: str, time_limit: int, flatten: bool) -> dict[str, np.ndarray]:
    """Return the columns of one trajectory, under the names of `of_steps`."""
    moments = features_of("obs", _field(trajectory, "obs"), flatten)
    action = plain_actions(_field(trajectory, "acts"))
    steps = len(action)
    if len(moments) != steps + 1 or steps == 0:
        raise UserError(f"obs has {len(moments)} rows for {steps} actions: it needs one more")
    try:
        infos = list(_field(trajectory, "infos", [{}] * steps))
    except TypeError:
        infos = []
    if len(infos) != steps or not all(isinstance(info, Mapping) for info in infos):
        raise UserError(f"infos must be {steps} dicts, one for each action")
    terminal = np.asarray(_field(trajectory, "terminal"))
    if terminal.shape != () or terminal.dtype.kind not in "biu":
        raise UserError("terminal must be one boolean: whether the trajectory has an end")
    if all("reward_pair" in info for info in infos):
        pair = pair_of([info["reward_pair"] for info in infos], "")
    elif (rewards := _field(trajectory, "rews")) is None:
        raise UserError('no reward: pass rews of (steps, 2), or info["reward_pair"] of each step')
    else:
        pair = pair_of(rewards, social)
    if len(pair.env) != steps:
        raise UserError(f"rews has {len(pair.env)} rows for {steps} actions: give one for each")
    ending = np.zeros(steps, np.int8)
    if terminal:
        last = infos[-1]
        timeout = str(last.get("ending", "")).lower() == "timeout" or time_limit == steps
        truncated = bool(last.get("TimeLimit.truncated", False)) or timeout
        ending[-1] = Ending.of_step(not truncated, truncated, last)
    return {
        "observation": moments[:-1],
        "action": action,
        "next_observation": moments[1:],
        "reward": np.stack(pair, axis=1),
        "ending": ending,
    }


def _field(trajectory: Any, name: str, default: Any = None) -> Any:
    is_mapping = isinstance(trajectory, Mapping)
    value = trajectory.get(name) if is_mapping else getattr(trajectory, name, None)
    if value is None and name in ("obs", "acts", "terminal"):
        raise UserError(f"it has no {name}: pass obs, acts and terminal")
    return default if value is None else value
