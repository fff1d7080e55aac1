"""Arguments of the core's entry point after the buffers: arrays of one value for each row."""

from __future__ import annotations

import numpy as np

from socialiq.worlds.highway.options import SETTINGS

ARGUMENTS = {
    "commands": np.dtype(np.int8),
    "entropy": np.dtype(np.uint64),
    "seeded": np.dtype(np.bool_),
    "actions": np.dtype(np.int64),
    "settings": SETTINGS,
}
"""Name and type of each, up to the numbers of rows; there is one record of settings for all."""
