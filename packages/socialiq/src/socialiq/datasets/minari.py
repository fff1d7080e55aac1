"""Minari data sets: HDF5, with the reward pair as a vector in `infos`.

Observations that are whole numbers become one-hot vectors, as in an environment of their space.

They are read without Minari, whose reader makes the environment of the metadata: that would import
and call code that the metadata name. Here the metadata are read as JSON and the HDF5 file as
numbers; offline training needs no more.

Minari keeps one reward a step, so the pair is in `infos["reward_vector"]`, of one row more than
there are steps, as all of Minari's `infos` have: row 0 belongs to the reset and is zeros. Without
it, rewards of two numbers a step, as a vector environment records them, are the pair. Other
columns of a table are in `infos["socialiq"]` and in the metadata.
"""

import errno
import json
import os
import re
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.spaces.utils import flatdim

from socialiq.datasets.arrays import Bounds, features_of, of_steps
from socialiq.datasets.hdf5 import MOST_NUMBERS, Reader, library
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.outputs import whole_folder
from socialiq.social.angle import check_angle, exact_weights, score
from socialiq.storage import read_json
from socialiq.worlds.wrapper import flat_rows, flat_space

MAIN_FILE = "main_data.hdf5"
METADATA_FILE = "metadata.json"
DATA_FOLDER = "data"
PAIR_NAMES = ("reward_vector", "reward_pair")
"""Names of a reward pair in `infos`; the first is the one that is written."""

OURS = "socialiq"
MOST_METADATA = 64 * 1024 * 1024  # bytes: Minari writes the bounds of every pixel


class _Space(NamedTuple):
    """Facts of a Gymnasium space: its class, shape and ends; number and first of discrete ones."""

    kind: str
    shape: tuple[int, ...]
    image: bool  # whether it looks like one to Minari
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
    """
    data = folder / DATA_FOLDER if (folder / DATA_FOLDER).is_dir() else folder
    metadata = _metadata(data / METADATA_FILE)
    space = _space(data, metadata, "action_space")
    discrete = space.kind == "Discrete" and 1 <= space.size < 2**31
    if not discrete and not (space.kind == "Box" and len(space.shape) == 1 and space.shape[0]):
        raise UserError(
            f"{data} has actions of a {one_line(space.kind, 40)} space of shape {space.shape}: "
            "only discrete actions are supported, or a Box of one vector"
        )
    actions = space._replace(size=0, start=0) if space.kind == "Box" else space
    with Reader(data / MAIN_FILE) as reader:
        columns = _columns(reader, data, metadata, actions, social, flatten)
    ours = metadata.get(OURS)
    if not isinstance(ours, dict):
        ours = None
        bounds = _bounds(data, actions, bounds)
    source: Any = ours.get("source") if ours else None
    if not isinstance(source, dict):
        source = {"made_by": "minari", "of": one_line(str(metadata.get("dataset_id", "")))}
    names = ours.get("mode_names") if ours else None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        most = int(columns["mode"].max(initial=0))  # where there are no names, the number is one
        names = [f"{mode}_{number}" for number in range(most + 1)] if most > 0 else [mode]
    try:
        sizes: dict[str, Any] = {"n_actions": actions.size, "bounds": bounds}
        table = of_steps(**columns, **sizes, mode_names=tuple(names), source=source)
    except UserError as error:
        raise UserError(f"{folder}: {error}") from error
    if ours is not None and ours.get("sha256") != files.sha256_of(table):
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
        name = one_line(str(metadata.get("data_format")), 40)
        raise UserError(f"{path}: data_format is {name}: only hdf5 is read, convert the data set")
    return metadata


def _space(path: Path, metadata: dict[str, Any], name: str) -> _Space:
    try:
        space = json.loads(metadata[name])
        shape = tuple(int(size) for size in space.get("shape", ()))
        start = space.get("start", 0)
        size = space.get("n", 0)
        if type(start) is not int or type(size) is not int:
            # A MultiBinary, for instance, which is refused by its type.
            start = 0
            size = 0
        image = space.get("dtype") == "uint8" and len(shape) in (2, 3) and min(shape[:2]) >= 32
        ends = space.get("low"), space.get("high")
        return _Space(str(space["type"]), shape, image, start, size, ends)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise UserError(f"{path}: the metadata have no {name}: write the data set again") from error


def _bounds(path: Path, actions: _Space, option: Bounds | None) -> Bounds | None:
    """Return the bounds of continuous actions, the user's or the space's own; None of discrete."""
    if actions.size or option is not None:
        return option
    try:
        ends = [np.asarray(end, np.float64) for end in actions.ends]
    except (ValueError, TypeError):
        ends = []
    shaped = len(ends) == 2 and all(end.shape == actions.shape for end in ends)
    if not shaped or not np.isfinite(ends).all():
        raise UserError(
            f"{path} has actions without finite bounds: name them (--action-low, --action-high)"
        )
    return Bounds.of(*(end.tolist() for end in ends))


def _columns(
    reader: Reader,
    path: Path,
    metadata: dict[str, Any],
    actions: _Space,
    social: str,
    flatten: bool,
) -> dict[str, Any]:
    """Return all columns of `of_steps`."""
    space = _space(path, metadata, "observation_space")
    whole = _whole_numbers(path, metadata, space)
    if space.kind != "Box" and whole is None:
        raise UserError(
            f"{path} has observations of a {one_line(space.kind, 40)} space: only plain arrays are "
            "read, flatten them first (gymnasium.wrappers.FlattenObservation)"
        )
    if space.image and metadata.get("jpeg_encoding", True):
        raise UserError(f"{path} keeps images as JPEG: record it with jpeg_encoding=False")
    if whole is not None:
        space = space._replace(shape=whole.shape or ())
    elif len(space.shape) > 1 and not flatten:
        raise UserError(f"{path} has observations of shape {space.shape}: flatten them (flatten)")
    size = reader.size()
    expected = metadata["total_episodes"]
    if size != expected or size < 1:
        raise UserError(
            f"{path} holds {size} episodes, but its metadata say {expected}: record it again"
        )
    tables = []
    pairs = 0
    for number in range(size):
        arrays = _of_episode(reader, f"episode_{number}", path, space, actions)
        observations = arrays["observations"]
        if whole is not None:
            observations = _one_hot(whole, observations, f"{path}: episode_{number}")
        moments = features_of("observations", observations, flatten=True)
        rewards = arrays["pair"][1:] if "pair" in arrays else arrays["rewards"]
        rewards = rewards if rewards.shape[1:] == (2,) else rewards.reshape(-1)
        pairs += rewards.ndim == 2
        table = {"observation": moments[:-1], "next_observation": moments[1:]}
        table |= {
            "action": arrays["actions"] - actions.start if actions.start else arrays["actions"]
        }
        table |= {"terminated": arrays["terminations"].reshape(-1)}
        table |= {"truncated": arrays["truncations"].reshape(-1), "reward": rewards}
        table |= {"episode": np.full(len(arrays["actions"]), number)}
        table |= {name: arrays[name][1:] for name in ("ending", "mode") if name in arrays}
        tables.append(table)
    if 0 < pairs < size:
        raise UserError(f"{path} has a reward pair in some episodes only: record it again")
    names = [name for name in tables[0] if all(name in table for table in tables)]
    joined: dict[str, Any] = {
        name: np.concatenate([table[name] for table in tables]) for name in names
    }
    return {"mode": np.zeros(len(joined["action"]), np.int8), "social": social} | joined


def _whole_numbers(
    path: Path, metadata: dict[str, Any], space: _Space
) -> gymnasium.Space[Any] | None:
    """Return the space of observations that are whole numbers; None of others."""
    described = json.loads(metadata["observation_space"])
    try:
        if space.kind == "Discrete":
            whole = spaces.Discrete(space.size, start=space.start)
        elif space.kind == "MultiBinary":
            whole = spaces.MultiBinary(described["n"])
        elif space.kind == "MultiDiscrete":
            start = described.get("start")
            whole = spaces.MultiDiscrete(described["nvec"], start=start)
        else:
            return None
        flat_space(whole)
    except (AssertionError, TypeError, ValueError, KeyError, OverflowError) as error:
        raise UserError(
            f"{path}: the metadata have no {space.kind} observation_space: write the data set again"
        ) from error
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    return whole


def _one_hot(space: gymnasium.Space[Any], observations: np.ndarray, where: str) -> np.ndarray:
    """Return whole numbers as the features that an environment of that space has (`flat_rows`)."""
    if len(observations) * flatdim(space) > MOST_NUMBERS:
        raise UserError(f"{where} is more than {MOST_NUMBERS:,} numbers as one-hot vectors")
    try:
        return flat_rows(space, observations)
    except ValueError as error:
        raise UserError(f"{where} observes {error}: record it again") from error


def _of_episode(
    reader: Reader, group: str, path: Path, space: _Space, actions: _Space
) -> dict[str, np.ndarray]:
    """Return the arrays of one episode, whose lengths agree."""
    names = ("actions", "rewards", "terminations", "truncations")
    arrays = {name: reader.array(f"{group}/{name}") for name in (*names, "observations")}
    infos = {name: f"{group}/infos/{OURS}/{name}" for name in ("ending", "mode")}
    for name in PAIR_NAMES[::-1]:
        if reader.has(f"{group}/infos/{name}"):
            infos["pair"] = f"{group}/infos/{name}"
    arrays |= {key: reader.array(name) for key, name in infos.items() if reader.has(name)}
    steps = arrays["actions"].shape[0]
    vector = () if actions.size else actions.shape
    shapes = dict.fromkeys(names, (steps,)) | {"actions": (steps, *vector)}
    shapes |= {"observations": (steps + 1, *space.shape)}
    shapes |= {"ending": (steps + 1,), "mode": (steps + 1,), "pair": (steps + 1, 2)}
    for name, array in arrays.items():
        is_pair = name == "rewards" and array.shape == (steps, 2)
        if not is_pair and array.shape not in (shapes[name], (*shapes[name], 1)):
            due = f"{shapes[name]} or {(steps, 2)}" if name == "rewards" else shapes[name]
            raise UserError(
                f"{path}: {name} of {group} has shape {array.shape} where {due} is due: record it "
                "again"
            )
    return arrays


def write_minari(
    demonstrations: Demonstrations, folder: Path, *, dataset_id: str = "", angle: float = 0.0
) -> Path:
    """Write a table as a Minari data set, whole or not at all.

    `minari.MinariDataset(folder / "data")` reads it. Where the folder is `ROOT/ID`, so does
    `minari.load_dataset(ID)` with MINARI_DATASETS_PATH=ROOT; no file is written anywhere else.

    Args:
        demonstrations: The table, of whole steps.
        folder: Folder to make.
        dataset_id: Minari's name of it, NAME-vN; by default the folder's name.
        angle: Social angle in degrees of the one reward that Minari keeps, R(α) (Eq 4.3).

    Returns:
        The folder that `minari.MinariDataset` reads.
    """
    check_angle(angle)
    table = demonstrations
    start = demonstrations.episode_starts
    skips = table.step != np.arange(table.n_transitions) - np.repeat(start, table.episode_lengths)
    inner = np.flatnonzero(np.diff(table.episode) == 0)
    after = table.next_observation[inner]
    following = table.observation[inner + 1]
    skips[inner + 1] |= (after.view(np.uint32) != following.view(np.uint32)).any(axis=1)
    if skips.any():  # Minari keeps T + 1 observations for T steps
        raise UserError(
            f"row {int(np.argmax(skips))} does not follow the row before it, and Minari keeps "
            "whole episodes only: write the table before it was subsampled"
        )
    library()
    optional("minari.dataset.minari_storage", "minari", "Minari data sets")
    minari = optional("minari", "minari", "Minari data sets")
    if folder.exists():
        raise UserError(f"{folder} exists already: name a new folder, or remove it first")
    name = dataset_id or id_of(folder)
    try:
        minari.dataset.minari_dataset.parse_dataset_id(name)
    except (ValueError, TypeError) as error:
        raise UserError(
            f"'{one_line(name)}' is not a Minari name: give letters, digits, - and _, then -v0"
        ) from error
    with whole_folder(folder) as temporary:
        _check_room(temporary, table)
        _write(minari, demonstrations, temporary.absolute() / DATA_FOLDER, name, angle)
    return folder / DATA_FOLDER


def id_of(folder: Path) -> str:
    """Return Minari's name of a data set from its folder."""
    name = re.sub(r"[^\w-]", "_", folder.absolute().name, flags=re.ASCII)
    return name if re.search(r"-v\d+$", name) else f"{name}-v0"


_OVERHEAD = 2**16
"""Bytes of an episode in HDF5 beside its numbers: groups, attributes and their least sizes."""


def _check_room(folder: Path, table: Demonstrations) -> None:
    """Reserve the bytes of a data set for a moment: HDF5 ends the process on a full disk.

    Raises:
        UserError: If there is not so much room.
    """
    numbers = table.observation.nbytes + 64 * table.n_transitions
    size = 2 * numbers + _OVERHEAD * len(table.episode_starts)
    with tempfile.TemporaryFile(dir=folder) as file:
        try:
            os.posix_fallocate(file.fileno(), 0, size)
        except AttributeError:  # the system has no such call
            return
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                raise UserError(
                    f"cannot write {size:,} bytes in {folder.parent}: {error.strerror}; make room, "
                    "or choose another place"
                ) from error


def _write(minari: ModuleType, table: Demonstrations, path: Path, name: str, angle: float) -> None:
    from minari.data_collector.episode_buffer import (  # pyright: ignore[reportMissingImports]
        EpisodeBuffer,
    )

    buffer: Any = EpisodeBuffer  # its types are lists
    try:
        path.mkdir()
        storage = minari.dataset.minari_storage.MinariStorage.new(
            path,
            observation_space=spaces.Box(-np.inf, np.inf, (table.n_features,), np.float32),
            action_space=spaces.Discrete(table.n_actions)
            if table.n_actions
            else spaces.Box(-1.0, 1.0, (table.action_size,), np.float32),
            data_format="hdf5",
        )
        reward = np.asarray(score(exact_weights(angle), table.rewards), np.float64)
        ends = np.append(table.episode_starts[1:], table.n_transitions)
        storage.update_episodes(
            buffer(
                observations=np.concatenate(
                    [table.observation[rows], table.next_observation[rows][-1:]]
                ),
                actions=table.action[rows].astype(np.int64 if table.n_actions else np.float32),
                rewards=reward[rows],
                terminations=table.terminated[rows],
                truncations=table.truncated[rows],
                infos={
                    PAIR_NAMES[0]: np.insert(np.stack(table.rewards, axis=1)[rows], 0, 0.0, axis=0),
                    OURS: {
                        "ending": np.insert(table.ending[rows], 0, 0),
                        "mode": np.append(table.mode[rows][:1], table.mode[rows]),
                    },
                },
            )
            for rows in map(slice, table.episode_starts, ends)
        )
        storage.update_metadata(
            {
                "dataset_id": name,
                "minari_version": minari.__version__,
                OURS: {
                    "version": 1,
                    "reward_angle": float(angle),
                    "mode_names": list(table.mode_names),
                    "source": table.source,
                    "sha256": files.sha256_of(table),
                },
            }
        )
    except OSError as error:
        raise UserError(f"cannot write {path}: {error}; choose another place") from error
