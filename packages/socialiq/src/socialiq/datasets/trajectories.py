"""Demonstrations from trajectories in the form of the `imitation` library, which is not needed.

A trajectory has `obs` (steps + 1), `acts` (steps) and `terminal`, and may have `rews` and `infos`
(steps). In `imitation`, `terminal` is also set where a time limit cut the episode. To a learner
that is not a terminal state, so it must be marked: by `info["TimeLimit.truncated"]`, which
Stable-Baselines3's vector environments set; by our worlds' `info["ending"]`; or by `time_limit`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64

from socialiq.datasets.actions import Bounds, plain_actions
from socialiq.datasets.arrays import of_steps
from socialiq.datasets.npz import read_npz
from socialiq.datasets.plain_columns import features_of, pair_of
from socialiq.datasets.step_columns import Layout
from socialiq.datasets.step_files import format_of, source_of
from socialiq.datasets.step_tables import read_csv, read_parquet
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair


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
    named = [modes] * len(listed) if isinstance(modes, str) else list(modes)
    if len(named) != len(listed):
        raise UserError(f"{len(named)} modes for {len(listed)} trajectories: name one for each")
    parts = []
    for number, one in enumerate(listed):
        try:
            parts.append(_columns(one, social, time_limit, flatten))
        except UserError as error:
            raise UserError(f"trajectory {number}: {error}") from error
    widths = {part["observation"].shape[1] for part in parts}
    if len(widths) > 1:
        raise UserError(f"trajectories differ in features ({', '.join(map(str, sorted(widths)))})")
    if len({part["action"].shape[1:] for part in parts}) > 1:
        raise UserError("trajectories differ in actions: give all of them the same kind and size")
    lengths = [len(part["action"]) for part in parts]
    names = tuple(dict.fromkeys(named))
    columns: dict[str, Any] = {
        name: np.concatenate([part[name] for part in parts]) for name in parts[0]
    }
    return of_steps(
        **columns,
        episode=np.repeat(np.arange(len(parts)), lengths),
        mode=np.repeat([names.index(one) for one in named], lengths),
        mode_names=names,
        n_actions=n_actions,
        bounds=bounds,
        source=source or {"made_by": "of_trajectories"},
    )


def read_trajectories(
    path: Path,
    *,
    n_actions: int = 0,
    bounds: Bounds | None = None,
    mode: str = "demonstrator",
    social: str = "",
    time_limit: int = 0,
    flatten: bool = False,
) -> Demonstrations:
    """Read a file of trajectories: `imitation`'s archive (.npz), or one row for each step.

    Args:
        path: .npz with the arrays of `of_condensed`; or .csv or .parquet with the columns of
            `ROWS`: `trajectory` numbers the trajectories, `terminal` is set in the last row of one
            that has an end.
        n_actions: Number of actions of the world; 0 for continuous ones.
        bounds: As of `arrays.of_steps`.
        mode: Name of the demonstrator.
        social: As of `of_trajectories`.
        time_limit: As of `of_trajectories`.
        flatten: As of `of_trajectories`.

    Raises:
        UserError: If the file is missing or damaged, or an array or column is missing or wrong.
    """
    kind, more = format_of(path), {"social": social, "time_limit": time_limit, "flatten": flatten}
    source = source_of(path) if path.is_file() else {}
    if kind == ".npz":
        arrays = read_npz(path, ("obs", "acts", "rews", "terminal", "indices"))
        return of_condensed(
            arrays, n_actions=n_actions, bounds=bounds, mode=mode, source=source, **more
        )
    columns = read_csv(path, ROWS) if kind == ".csv" else read_parquet(path, layout=ROWS)[0]
    try:
        parts = _by_trajectory(ROWS.arrays_of(columns, str(path)))
        return of_trajectories(
            parts, n_actions=n_actions, bounds=bounds, modes=mode, source=source, **more
        )
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
    number, terminal = rows["trajectory"], rows["terminal"]
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


def of_condensed(
    arrays: Mapping[str, Any],
    *,
    n_actions: int = 0,
    bounds: Bounds | None = None,
    mode: str = "demonstrator",
    social: str = "",
    time_limit: int = 0,
    flatten: bool = False,
    source: dict[str, Any] | None = None,
) -> Demonstrations:
    """Make a table from `imitation`'s older archive: all trajectories end to end.

    Args:
        arrays: `obs`, `acts`, `rews` end to end; `terminal` of each trajectory; `indices`, the
            first step of each but the first. The archive's `infos` are pickled and never read, so
            its time limits are known by `time_limit` alone.
        n_actions: Number of actions of the world; 0 for continuous ones.
        bounds: As of `arrays.of_steps`.
        mode: Name of the demonstrator.
        social: As of `of_trajectories`.
        time_limit: As of `of_trajectories`.
        flatten: As of `of_trajectories`.
        source: Provenance of the data.

    Raises:
        UserError: If an array is missing or wrong.
    """
    missing = [name for name in ("obs", "acts", "terminal", "indices") if name not in arrays]
    if missing:
        raise UserError(f"no {', '.join(missing)}: save obs, acts, terminal and indices")
    terminal, acts = np.asarray(arrays["terminal"]), np.asarray(arrays["acts"])
    obs, rews = np.asarray(arrays["obs"]), arrays.get("rews")
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
    trajectories = [
        {
            "obs": obs[begin + place : end + place + 1],
            "acts": acts[begin:end],
            "rews": None if rews is None else rews[begin:end],
            "terminal": terminal[place],
        }
        for place, (begin, end) in enumerate(itertools.pairwise(edges))
    ]
    return of_trajectories(
        trajectories,
        n_actions=n_actions,
        bounds=bounds,
        modes=mode,
        social=social,
        time_limit=time_limit,
        flatten=flatten,
        source=source,
    )


def _columns(one: Any, social: str, time_limit: int, flatten: bool) -> dict[str, np.ndarray]:
    """Return the columns of one trajectory, under the names of `of_steps`."""
    seen: Float32[np.ndarray, "moment feature"] = features_of("obs", _field(one, "obs"), flatten)
    action = plain_actions(_field(one, "acts"))
    steps = len(action)
    if len(seen) != steps + 1 or steps == 0:
        raise UserError(f"obs has {len(seen)} rows for {steps} actions: it needs one more")
    infos = _infos(one, steps)
    ending = np.zeros(steps, np.int8)
    ending[-1] = _ending(_terminal(one), infos[-1], time_limit == steps)
    return {
        "observation": seen[:-1],
        "action": action,
        "next_observation": seen[1:],
        "reward": np.stack(_rewards(one, infos, social), axis=1),
        "ending": ending,
    }


def _field(one: Any, name: str, default: Any = None) -> Any:
    found = one.get(name) if isinstance(one, Mapping) else getattr(one, name, None)
    if found is None and name in ("obs", "acts", "terminal"):
        raise UserError(f"it has no {name}: pass obs, acts and terminal")
    return default if found is None else found


def _infos(one: Any, steps: int) -> list[Mapping[str, Any]]:
    found = _field(one, "infos", [{}] * steps)
    try:
        listed = list(found)
    except TypeError:
        listed = []
    if len(listed) != steps or not all(isinstance(info, Mapping) for info in listed):
        raise UserError(f"infos must be {steps} dicts, one for each action")
    return listed


def _terminal(one: Any) -> bool:
    terminal = np.asarray(_field(one, "terminal"))
    if terminal.shape != () or terminal.dtype.kind not in "biu":
        raise UserError("terminal must be one boolean: whether the trajectory has an end")
    return bool(terminal)


def _ending(terminal: bool, info: Mapping[str, Any], cut: bool) -> Ending:
    """Return the ending of the last step."""
    if not terminal:
        return Ending.NONE
    named = str(info.get("ending", "")).lower() == "timeout"
    truncated = bool(info.get("TimeLimit.truncated", False)) or named or cut
    return Ending.of_step(not truncated, truncated, info)


def _rewards(one: Any, infos: list[Mapping[str, Any]], social: str) -> RewardPair:
    if all("reward_pair" in info for info in infos):
        pair = pair_of([info["reward_pair"] for info in infos], "")
    elif (rews := _field(one, "rews")) is None:
        raise UserError('no reward: pass rews of (steps, 2), or info["reward_pair"] of each step')
    else:
        pair = pair_of(rews, social)
    env: Float64[np.ndarray, " step"] = pair.env
    if len(env) != len(infos):
        raise UserError(f"rews has {len(env)} rows for {len(infos)} actions: give one for each")
    return pair
