"""Every reader of recordings and of demonstrations: arrays of what it read from the samples."""

from __future__ import annotations

import functools
from pathlib import Path

from safetensors.numpy import load_file
from tests.digest.commands import EXAMPLES, call
from tests.digest.digest import Hashes, Item, of_arrays
from tests.digest.saved import samples

RECORDINGS: dict[str, tuple[str, ...]] = {
    "commonroad": ("commonroad", "recording.xml"),
    "commonroad-lights": ("commonroad", "lit.xml"),
    "ind": ("csv", "ind/0_tracks.csv", "ind"),
    "sind": ("sind", "sind/made_Ped_smoothed_tracks.csv"),
    "columns": ("csv", "mine.csv", "columns.toml"),
}
"""Format, sample and map of the columns by name."""

STEPS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "npz": (("from-arrays", "steps.npz"), ()),
    "csv": (("from-arrays", "steps.csv"), ()),
    "parquet": (("from-arrays", "steps.parquet"), ("pyarrow",)),
    "hdf5": (("from-arrays", "steps.hdf5"), ("h5py",)),
    "minari": (("from-minari", "minari"), ("h5py",)),
    "trajectories-npz": (("from-trajectories", "rollouts.npz"), ()),
    "trajectories-csv": (("from-trajectories", "rollouts.csv"), ()),
}
"""Command and sample of a file of demonstrations, and the extra that it needs."""


def imported(words: tuple[str, ...], folder: Path) -> Hashes:
    """Import a recording; hash the tracks and the road to the last bit."""
    kind, sample, *columns = words
    more = [samples() / name if name.endswith(".toml") else name for name in columns]
    options = ["--columns", *more] if more else []
    call("data", "import", kind, samples() / sample, *options, "--out", folder / "out")
    return of_files(folder / "out")


def imported_example(folder: Path) -> Hashes:
    """Import the second example, whose vehicles interact."""
    path = EXAMPLES / "recordings" / "ZAM_Crossing-2_1_T-1.xml"
    call("data", "import", "commonroad", path, "--out", folder / "out")
    return of_files(folder / "out")


def of_files(folder: Path) -> Hashes:
    """Hash the arrays of each file in a folder."""
    paths = sorted(folder.glob("*.safetensors"))
    return {
        f"tracks/{number}": of_arrays(load_file(path), True) for number, path in enumerate(paths)
    }


def converted(words: tuple[str, ...], folder: Path) -> Hashes:
    """Convert demonstrations to a file of ours; hash its arrays to the last bit."""
    command, sample = words
    more: tuple[str, ...] = ()
    if command == "from-trajectories":
        more = ("--n-actions", "2", "--social=none")
    elif sample.endswith(".csv"):
        more = ("--n-actions", "3", "--mode", "egoistic", "prosocial", "altruistic")
    out = folder / "steps.safetensors"
    call("data", command, samples() / sample, *more, "--out", out)
    return {"steps": of_arrays(load_file(out), True)}


ITEMS = [
    *(
        Item(f"reader/{name}", functools.partial(imported, words), ("shapely",), quick=True)
        for name, words in RECORDINGS.items()
    ),
    Item("reader/commonroad-example", imported_example, ("shapely",)),
    *(
        Item(
            f"reader/steps-{name}",
            functools.partial(converted, words),
            ("shapely", *needs),
            quick=True,
        )
        for name, (words, needs) in STEPS.items()
    ),
]
