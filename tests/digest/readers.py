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


def imported_layout(layout: str, folder: Path) -> Hashes:
    """Write the tracks of two cars in the layout of a data set, and import them."""
    from benchmarks.recordings import write_csv
    from tests.fuzz.samples import COLUMNS

    from socialiq_recordings import files

    head = "who,frame,x,y,heading,vx,vy,length,width,class"
    rows = [
        f"{who},{frame},{frame / 2},{4 * who},0.0,5.0,0.0,4.5,1.8,Car"
        for who in (1, 2)
        for frame in range(30)
    ]
    (folder / "mine.csv").write_text("\n".join([head, *rows]) + "\n")
    (folder / "columns.toml").write_text(COLUMNS)
    columns = ("--columns", folder / "columns.toml")
    call("data", "import", "csv", folder / "mine.csv", *columns, "--out", folder / "mine")
    (recording,) = (folder / "mine").glob("*.safetensors")
    written = write_csv(files.load(recording).tracks, layout, folder)
    call("data", "import", "csv", written, "--columns", layout, "--out", folder / "out")
    return of_files(folder / "out")


def imported_highd(folder: Path) -> Hashes:
    """Import a file in the layout of highD, whose boxes have a corner and whose y points down."""
    head = "frame,id,x,y,width,height,xVelocity,yVelocity"
    rows = [
        f"{frame},{number},{20 * number + 1.2 * frame},{4.0 * number},4.6,1.9,30.0,0.0"
        for number in (1, 2)
        for frame in range(1, 26)
    ]
    tables = {
        "tracks": [head, *rows],
        "tracksMeta": ["id,class", "1,Car", "2,Truck"],
        "recordingMeta": ["frameRate", "25"],
    }
    for name, lines in tables.items():
        (folder / f"01_{name}.csv").write_text("\n".join(lines) + "\n")
    path = folder / "01_tracks.csv"
    call("data", "import", "csv", path, "--columns", "highd", "--out", folder / "out")
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
    *(
        Item(f"reader/{name}", functools.partial(imported_layout, name), quick=True)
        for name in ("interaction", "ngsim")
    ),
    Item("reader/highd", imported_highd, quick=True),
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
