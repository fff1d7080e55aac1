"""Import of Minari data sets without Minari, whose reader makes the environment of the metadata.

Making it would import and call code that the metadata name. Here the metadata are read as JSON and
the HDF5 file as numbers; offline training needs nothing else.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from socialiq.datasets.actions import Bounds
from socialiq.datasets.arrays import of_steps
from socialiq.datasets.hdf5 import Reader
from socialiq.datasets.plain_columns import features_of
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.storage import read_json

MAIN_FILE, METADATA_FILE, DATA_FOLDER = "main_data.hdf5", "metadata.json", "data"
PAIR_NAMES = ("reward_vector", "reward_pair")
"""Names of a reward pair in `infos`; the first is the one that is written."""

OURS = "socialiq"
MOST_METADATA = 64 * 1024 * 1024  # bytes: Minari writes the bounds of every pixel


class _Space(NamedTuple):
    """Facts of a Gymnasium space.

    Attributes:
        kind: Name of its class.
        shape: Shape of an element.
        image: Whether it looks like an image to Minari.
        start: First number of a discrete space.
        size: Number of elements of a discrete space; 0 of others.
        ends: Lower and upper ends of a box, as the metadata have them.
    """

    kind: str
    shape: tuple[int, ...]
    image: bool
    start: int
    size: int
    ends: tuple[Any, Any]


def read_minari(
    folder: Path,
    *,
    social: str = "",
    mode: str = "demonstrator",
    flatten: bool = False,
    bounds: Bounds | None = None,
) -> Demonstrations:
    """Read a Minari data set, of `write_minari` or of another program, without its environment.

    Args:
        folder: The data set's folder, or the `data` folder in it.
        social: "none" if the one reward is r_env and r_social is 0, for data without a pair.
        mode: Name of the demonstrator, where the data set names none.
        flatten: Whether observations of more axes (images) are flattened to one.
        bounds: Ends of continuous actions, where those of the data set's own space are not finite.

    Raises:
        UserError: If it is missing or damaged; if its actions are neither discrete nor vectors
            within bounds, or its observations no numbers; if it has no reward pair and `social` is
            not given; if it was changed since it was written.
    """
    inner = folder / DATA_FOLDER
    place = inner if inner.is_dir() else folder
    metadata = _metadata(place / METADATA_FILE)
    actions = _actions(place, metadata)
    with Reader(place / MAIN_FILE) as reader:
        columns = _columns(reader, place, metadata, actions, social, flatten)
    ours = metadata.get(OURS)
    if not isinstance(ours, dict):
        bounds = _bounds(place, actions, bounds)
    names, source = _named(ours, columns["mode"], mode), {"made_by": "minari", "of": _id(metadata)}
    if isinstance(ours, dict) and isinstance(ours.get("source"), dict):
        source = ours["source"]
    try:
        sizes: dict[str, Any] = {"n_actions": actions.size, "bounds": bounds}
        table = of_steps(**columns, **sizes, mode_names=names, source=source)
    except UserError as error:
        raise UserError(f"{folder}: {error}") from error
    if isinstance(ours, dict) and ours.get("sha256") != files.sha256_of(table):
        raise UserError(f"{folder} is not what was written (its SHA-256 differs): write it again")
    return table


def _metadata(path: Path) -> dict[str, Any]:
    if path.is_file() and path.stat().st_size > MOST_METADATA:
        raise UserError(
            f"{path} is larger than {MOST_METADATA:,} bytes: this is not a Minari data set"
        )
    metadata = read_json(path)
    if not isinstance(metadata, dict) or not isinstance(metadata.get("total_episodes"), int):
        raise UserError(f"{path} is not of a Minari data set: it has no total_episodes")
    if metadata.get("data_format") != "hdf5":
        kept = one_line(str(metadata.get("data_format")), 40)
        raise UserError(f"{path}: data_format is {kept}: only hdf5 is read, convert the data set")
    return metadata


def _id(metadata: dict[str, Any]) -> str:
    return one_line(str(metadata.get("dataset_id", "")))


def _space(path: Path, metadata: dict[str, Any], name: str) -> _Space:
    try:
        space = json.loads(metadata[name])
        shape = tuple(int(size) for size in space.get("shape", ()))
        start, size = space.get("start", 0), space.get("n", 0)
        if type(start) is not int or type(size) is not int:
            start, size = 0, 0  # for instance of a MultiBinary, which is refused by its type
        image = space.get("dtype") == "uint8" and len(shape) in (2, 3) and min(shape[:2]) >= 32
        ends = space.get("low"), space.get("high")
        return _Space(str(space["type"]), shape, image, start, size, ends)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise UserError(f"{path}: the metadata have no {name}: write the data set again") from error


def _actions(path: Path, metadata: dict[str, Any]) -> _Space:
    space = _space(path, metadata, "action_space")
    discrete = space.kind == "Discrete" and 1 <= space.size < 2**31
    if not discrete and not (space.kind == "Box" and len(space.shape) == 1 and space.shape[0]):
        raise UserError(
            f"{path} has actions of a {one_line(space.kind, 40)} space of shape {space.shape}: "
            "only discrete actions are supported, or a Box of one vector"
        )
    return space._replace(size=0, start=0) if space.kind == "Box" else space


def _bounds(path: Path, actions: _Space, given: Bounds | None) -> Bounds | None:
    """Return the bounds of continuous actions, those given or the space's own; None of discrete.

    Raises:
        UserError: If there are none.
    """
    if actions.size or given is not None:
        return given
    try:
        ends = [np.asarray(one, np.float64) for one in actions.ends]
    except (ValueError, TypeError):
        ends = []
    shaped = len(ends) == 2 and all(one.shape == actions.shape for one in ends)
    if not shaped or not np.isfinite(ends).all():
        raise UserError(
            f"{path} has actions without finite bounds: name them (--action-low, --action-high)"
        )
    return Bounds.of(*(one.tolist() for one in ends))


def _columns(
    reader: Reader,
    path: Path,
    metadata: dict[str, Any],
    actions: _Space,
    social: str,
    flatten: bool,
) -> dict[str, Any]:
    """Return all columns of `of_steps`."""
    seen = _space(path, metadata, "observation_space")
    if seen.kind not in ("Box", "Discrete"):
        raise UserError(
            f"{path} has observations of a {one_line(seen.kind, 40)} space: only plain arrays are "
            "read, flatten them first (gymnasium.wrappers.FlattenObservation)"
        )
    if seen.image and metadata.get("jpeg_encoding", True):
        raise UserError(f"{path} keeps images as JPEG: record it with jpeg_encoding=False")
    if len(seen.shape) > 1 and not flatten:
        raise UserError(f"{path} has observations of shape {seen.shape}: flatten them (flatten)")
    size, expected = reader.size(), metadata["total_episodes"]
    if size != expected or size < 1:
        raise UserError(
            f"{path} holds {size} episodes, but its metadata say {expected}: record it again"
        )
    vector = () if actions.size else actions.shape
    parts = [_of_episode(reader, f"episode_{one}", path, seen, vector) for one in range(size)]
    pairs = sum("pair" in part for part in parts)
    if 0 < pairs < size:
        raise UserError(f"{path} has a reward pair in some episodes only: record it again")
    parts = [_as_rows(part, number) for number, part in enumerate(parts)]
    if actions.start:
        for part in parts:
            part["action"] = part["action"] - actions.start
    names = [name for name in parts[0] if all(name in part for part in parts)]
    joined: dict[str, Any] = {
        name: np.concatenate([part[name] for part in parts]) for name in names
    }
    return {"mode": np.zeros(len(joined["action"]), np.int8), "social": social} | joined


def _of_episode(
    reader: Reader, group: str, path: Path, space: _Space, action: tuple[int, ...]
) -> dict[str, np.ndarray]:
    """Return the arrays of one episode, whose lengths agree; `action` is the shape of an action."""
    names = ("actions", "rewards", "terminations", "truncations")
    part = {name: reader.array(f"{group}/{name}") for name in names}
    part["observations"] = reader.array(f"{group}/observations")
    wanted = {name: f"{group}/infos/{OURS}/{name}" for name in ("ending", "mode")}
    for name in PAIR_NAMES[::-1]:
        if reader.has(f"{group}/infos/{name}"):
            wanted["pair"] = f"{group}/infos/{name}"
    part |= {key: reader.array(name) for key, name in wanted.items() if reader.has(name)}
    steps = part["actions"].shape[0]
    shapes = dict.fromkeys(names, (steps,)) | {"actions": (steps, *action)}
    shapes |= {"observations": (steps + 1, *space.shape)}
    shapes |= {"ending": (steps + 1,), "mode": (steps + 1,), "pair": (steps + 1, 2)}
    for name, array in part.items():
        if array.shape != shapes[name] and not _is_column(array, shapes[name]):
            raise UserError(
                f"{path}: {name} of {group} has shape {array.shape} where {shapes[name]} is due: "
                "record it again"
            )
    return part


def _is_column(array: np.ndarray, shape: tuple[int, ...]) -> bool:
    return array.shape == (*shape, 1)


def _as_rows(part: dict[str, np.ndarray], number: int) -> dict[str, np.ndarray]:
    """Return one episode as rows of a table."""
    seen = features_of("observations", part["observations"], flatten=True)
    steps = len(part["actions"])
    rows = {
        "observation": seen[:-1],
        "next_observation": seen[1:],
        "action": part["actions"],
        "terminated": part["terminations"].reshape(-1),
        "truncated": part["truncations"].reshape(-1),
        "reward": part["pair"][1:] if "pair" in part else part["rewards"].reshape(-1),
        "episode": np.full(steps, number),
    }
    return rows | {name: part[name][1:] for name in ("ending", "mode") if name in part}


def _named(ours: Any, mode: np.ndarray, other: str) -> tuple[str, ...]:
    """Return the demonstrators' names; where the data set has none, the number is the name."""
    names = ours.get("mode_names") if isinstance(ours, dict) else None
    if isinstance(names, list) and all(isinstance(name, str) for name in names):
        return tuple(names)
    most = int(mode.max()) if len(mode) else 0
    return (other,) if most <= 0 else tuple(f"{other}_{number}" for number in range(most + 1))
