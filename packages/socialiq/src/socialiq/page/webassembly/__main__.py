"""`python -m socialiq.page.webassembly`: build the core again from its sources."""

import tempfile
from pathlib import Path

import tyro

from socialiq.page.webassembly.build import linked, object_file
from socialiq.page.webassembly.layout import CORE


def build(out: Path = CORE) -> None:
    """Build the core as WebAssembly; needs the extra `page`.

    Args:
        out: The file to write; by default the one in the package.
    """
    with tempfile.TemporaryDirectory() as folder:
        core = Path(folder) / "core.o"
        object_file(core)
        linked(core, out)


if __name__ == "__main__":
    tyro.cli(build)
