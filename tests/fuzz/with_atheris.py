"""Fuzz one reader with atheris, which looks at what the code did with the last file.

In an environment of its own, since atheris has wheels of some versions of Python only:
`pip install atheris==3.0.0`, then `python -m tests.fuzz.with_atheris NAME [-max_total_time=600]`.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import atheris  # pyright: ignore[reportMissingImports]

with atheris.instrument_imports(include=["socialiq"]):
    from tests.fuzz.readers import READERS, place_of
    from tests.fuzz.run_readers import Counts, check
    from tests.fuzz.samples import make_samples


def main() -> None:
    """Give the reader of the name in the first argument files until libFuzzer stops."""
    name, *options = sys.argv[1:]
    (reader,) = (one for one in READERS if one.name == name)
    folder = Path(tempfile.mkdtemp())
    ok, seeds = folder / "ok", folder / "seeds"
    ok.mkdir()
    seeds.mkdir()
    make_samples(ok)
    place, counts = place_of(reader, ok, folder / "work"), Counts()
    (seeds / "sample").write_bytes((ok / reader.sample).read_bytes())

    def once(content: bytes) -> None:
        place.write_bytes(content)
        counts.files += 1
        counts.accepted += check(reader, place)

    atheris.Setup([sys.argv[0], *options, str(seeds)], once)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
