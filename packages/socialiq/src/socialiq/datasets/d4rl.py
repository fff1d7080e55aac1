"""Demonstrations in and out in D4RL's layout: flat arrays of HDF5, one row for each step."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.datasets.hdf5 import Reader, library
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError

NAMES = {
    "observation": "observations",
    "action": "actions",
    "terminated": "terminals",
    "truncated": "timeouts",
    "next_observation": "next_observations",
}
"""D4RL's name of each column."""

REWARD, PAIRS = "rewards", ("infos/reward_vector", "infos/reward_pair")
"""D4RL's reward, and what holds a pair of rewards beside it; the first of these is written."""

MORE = ("ending", "mode", "episode", "step")
"""Columns of a table that D4RL has no name for; they are kept in `infos/socialiq`."""

OURS = "infos/socialiq"


def read_d4rl(path: Path, key: str) -> tuple[dict[str, Any], bytes | None]:
    """Read the arrays of `arrays.of_steps` from a file in D4RL's layout.

    Args:
        path: The file.
        key: Attribute of the file with a header.

    Returns:
        The arrays by their names there, and the header or None.

    Raises:
        UserError: If the file is missing or damaged, an array is missing, or nothing says what
            follows the last step of an episode.
    """
    with Reader(path) as reader:
        missing = [name for name in (*list(NAMES.values())[:3], REWARD) if not reader.has(name)]
        if missing:
            raise UserError(f"{path} has no {', '.join(missing)}: is it of D4RL's layout?")
        if not reader.has(NAMES["next_observation"]):
            raise UserError(
                f"{path} has no next_observations: what follows the last step of an episode is in "
                "no other array"
            )
        found = {name: reader.array(one) for name, one in NAMES.items() if reader.has(one)}
        pair = next((one for one in PAIRS if reader.has(one)), REWARD)
        found["reward"] = reader.array(pair)
        header = reader.text(key)
        if header is not None:
            found |= {name: reader.array(f"{OURS}/{name}") for name in MORE}
        return found, header


def d4rl_of(table: Demonstrations, key: str, header: bytes) -> bytes:
    """Return a table as the bytes of a file in D4RL's layout; its one reward is r_env.

    Args:
        table: The table.
        key: Attribute of the file that holds the header.
        header: The header.

    Raises:
        UserError: If h5py is not installed.
    """
    h5py, content = library("HDF5 files"), io.BytesIO()
    columns = table.arrays()
    with h5py.File(content, "w") as file:
        for name, theirs in NAMES.items():
            file.create_dataset(theirs, data=columns[name])
        file.create_dataset(REWARD, data=table.rewards.env)
        file.create_dataset(PAIRS[0], data=np.stack(table.rewards, axis=1))
        for name in MORE:
            file.create_dataset(f"{OURS}/{name}", data=columns[name])
        file.attrs[key] = np.void(header)
    return content.getvalue()
