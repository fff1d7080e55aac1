"""Count the Stable-Baselines3 policies that are read, in a folder of zips such as the RL Zoo's.

    git clone https://github.com/DLR-RM/rl-trained-agents
    python benchmarks/zoo.py rl-trained-agents

The first folder's name is the algorithm. A policy trained under VecNormalize counts as read "with
statistics" if it is read after statistics were added, of mean 0 and variance 1: its own are a
pickle, which is never loaded. `best_model.zip` is a second copy and is not counted.
"""

import collections
import io
import json
import sys
import zipfile
from pathlib import Path

from socialiq.errors import UserError
from socialiq.policies.sb3_config import config_of, data_of
from socialiq.policies.sb3_load import MOST_WORDS, STATISTICS, read_sb3
from socialiq.policies.sb3_tensors import Archive


def kind_of_reading(content: bytes) -> str:
    """Return "read", "read with statistics", or why the policy is refused."""
    try:
        data = data_of(Archive(content, "zip").read("data", MOST_WORDS), "zip")
        interface = config_of(data, "zip").interface
        try:
            read_sb3(content, "zip", interface)
            return "read"
        except UserError as error:
            if STATISTICS not in str(error):
                raise
        buffer, size = io.BytesIO(content), interface.n_features
        with zipfile.ZipFile(buffer, "a") as archive:
            archive.writestr(STATISTICS, json.dumps({"mean": [0.0] * size, "var": [1.0] * size}))
        read_sb3(buffer.getvalue(), "zip", interface)
        return "read with statistics"
    except UserError as error:
        return str(error).partition(";")[0]


def main(folder: Path) -> None:
    """Print counts by algorithm, and in all."""
    counts = collections.Counter()
    for path in sorted(folder.rglob("*.zip")):
        if path.stem != "best_model":
            algorithm = path.relative_to(folder).parts[0]
            counts[algorithm, kind_of_reading(path.read_bytes())] += 1
    for (algorithm, reading), count in sorted(counts.items()):
        print(f"{count:4d}  {algorithm:8s}  {reading}")
    for reading in ("read", "read with statistics"):
        print(f"{sum(n for (_, kind), n in counts.items() if kind == reading):4d}  {reading}")
    print(f"{counts.total():4d}  zips")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
