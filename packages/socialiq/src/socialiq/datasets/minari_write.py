"""Export of Minari data sets: HDF5, with the reward pair as a vector in `infos`.

Minari keeps one reward a step, so the pair is in `infos["reward_vector"]`, of one row more
than there are steps, as all of Minari's `infos` have: row 0 belongs to the reset and is zeros.
Other columns of a table are in `infos["socialiq"]` and in the metadata.
"""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from socialiq.datasets.hdf5 import library
from socialiq.datasets.minari_read import DATA_FOLDER, OURS, PAIR_NAMES
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.outputs import whole_folder
from socialiq.social.angle import check_angle, exact_weights, score


def write_minari(
    demonstrations: Demonstrations, folder: Path, *, dataset_id: str = "", angle: float = 0.0
) -> Path:
    """Write a table as a Minari data set, whole or not at all.

    `minari.MinariDataset(folder / "data")` reads it. Where the folder is `ROOT/ID`, so does
    `minari.load_dataset(ID)` with MINARI_DATASETS_PATH=ROOT; nothing is written anywhere else.

    Args:
        demonstrations: The table, of whole steps.
        folder: Folder to make.
        dataset_id: Minari's name of it, NAME-vN; by default the folder's name.
        angle: Social angle in degrees of the one reward that Minari keeps, R(α) (Eq 4.3).

    Returns:
        The folder that `minari.MinariDataset` reads.

    Raises:
        UserError: If the folder exists, the table skips steps, the name is none for Minari, or the
            extra `minari` is not installed.
    """
    check_angle(angle)
    _check_connected(demonstrations)
    minari = _minari()
    if folder.exists():
        raise UserError(f"{folder} exists already: name a new folder, or remove it first")
    name = _checked_id(minari, dataset_id or id_of(folder))
    with whole_folder(folder) as part:
        _write(minari, demonstrations, part.absolute() / DATA_FOLDER, name, angle)
    return folder / DATA_FOLDER


def _minari() -> ModuleType:
    library()
    optional("minari.dataset.minari_storage", "minari", "Minari data sets")
    return optional("minari", "minari", "Minari data sets")


def _check_connected(table: Demonstrations) -> None:
    """Refuse tables that skip steps: Minari keeps T + 1 observations for T steps."""
    starts = np.repeat(table.episode_starts, table.episode_lengths)
    skips = table.step != np.arange(table.n_transitions) - starts
    inner = np.flatnonzero(np.diff(table.episode) == 0)
    after, seen = table.next_observation[inner], table.observation[inner + 1]
    skips[inner + 1] |= (after.view(np.uint32) != seen.view(np.uint32)).any(axis=1)
    if skips.any():
        row = int(np.argmax(skips))
        raise UserError(
            f"row {row} does not follow the row before it, and Minari keeps whole episodes only: "
            "write the table before it was subsampled"
        )


def id_of(folder: Path) -> str:
    """Return Minari's name of a data set from its folder."""
    name = re.sub(r"[^\w-]", "_", folder.absolute().name, flags=re.ASCII)
    return name if re.search(r"-v\d+$", name) else f"{name}-v0"


def _checked_id(minari: ModuleType, name: str) -> str:
    try:
        minari.dataset.minari_dataset.parse_dataset_id(name)
    except (ValueError, TypeError) as error:
        raise UserError(
            f"'{one_line(name)}' is not a Minari name: give letters, digits, - and _, then -v0"
        ) from error
    return name


def _write(minari: ModuleType, table: Demonstrations, place: Path, name: str, angle: float) -> None:
    from gymnasium import spaces
    from minari.data_collector.episode_buffer import (  # pyright: ignore[reportMissingImports]
        EpisodeBuffer,
    )

    try:
        place.mkdir()
        storage = minari.dataset.minari_storage.MinariStorage.new(
            place,
            observation_space=spaces.Box(-np.inf, np.inf, (table.n_features,), np.float32),
            action_space=spaces.Discrete(table.n_actions)
            if table.n_actions
            else spaces.Box(-1.0, 1.0, (table.action_size,), np.float32),
            data_format="hdf5",
        )
        reward = np.asarray(score(exact_weights(angle), table.rewards), np.float64)
        ends = np.append(table.episode_starts[1:], table.n_transitions)
        storage.update_episodes(
            EpisodeBuffer(**_episode(table, slice(start, end), reward))
            for start, end in zip(table.episode_starts, ends, strict=True)
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
        raise UserError(f"cannot write {place}: {error}; choose another place") from error


def _episode(table: Demonstrations, rows: slice, reward: np.ndarray) -> dict[str, Any]:
    """Return the fields of Minari's buffer of one episode."""

    def with_reset(column: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros_like(column[:1]), column])

    pair = np.stack([column[rows] for column in table.rewards], axis=1)
    ours = {"ending": with_reset(table.ending[rows])}
    ours["mode"] = np.append(table.mode[rows][:1], table.mode[rows])
    return {
        "observations": np.concatenate(
            [table.observation[rows], table.next_observation[rows][-1:]]
        ),
        "actions": table.action[rows].astype(np.int64 if table.n_actions else np.float32),
        "rewards": reward[rows],
        "terminations": table.terminated[rows],
        "truncations": table.truncated[rows],
        "infos": {PAIR_NAMES[0]: with_reset(pair), OURS: ours},
    }
