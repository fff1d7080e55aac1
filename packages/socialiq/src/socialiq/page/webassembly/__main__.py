"""`python -m socialiq.page.webassembly`: build the core again from its sources."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import tyro

from socialiq.page.webassembly.build import linked, object_file
from socialiq.page.webassembly.layout import CORE


@dataclass(frozen=True)
class Build:
    """Build the core as WebAssembly; needs the extra `page`."""

    out: Path = CORE
    """The file to write; by default the one in the package."""

    def run(self) -> None:
        """Compile and link."""
        with tempfile.TemporaryDirectory() as folder:
            core = Path(folder) / "core.o"
            object_file(core)
            linked(core, self.out)


if __name__ == "__main__":
    tyro.cli(Build).run()
