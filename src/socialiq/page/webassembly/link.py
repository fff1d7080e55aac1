"""Linking by Zig's compiler, which the wheel `ziglang` holds (extra `page`)."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from socialiq.errors import UserError
from socialiq.page.webassembly.emit import SYMBOL

EXPORTS = (SYMBOL, "allocate", "memory")
"""What a program that loads the file can use."""

_HERE = Path(__file__).parent
_POWER = ("pow", "pow_data", "exp_data", "__math_invalid", "__math_oflow", "__math_uflow", "__math_xflow")
_HEADERS = ("musl/src/include", "musl/src/internal", "musl/include", "musl/arch/generic")
_GENERATED = ("wasm-wasi-musl", "generic-musl")


def linked(core: Path, target: Path) -> None:
    """Write the WebAssembly file of an object file; it imports nothing.

    Args:
        core: Object file of `emit.object_file`.
        target: The file to write.

    Raises:
        UserError: If the extra `page` isn't installed, or the linker fails.
    """
    options = ["-target", "wasm32-freestanding", "-O", "ReleaseSmall", "-fno-entry", "-fstrip"]
    options += [f"--export={name}" for name in EXPORTS if name != "memory"]
    _zig(["build-exe", *options, str(core), str(_HERE / "runtime.zig")], target)


def elementary_functions(target: Path) -> None:
    """Write a shared library for this machine with the elementary functions of the page.

    Raises:
        UserError: As `linked`.
    """
    options = ["-dynamic", "-O", "ReleaseFast", "-mcpu", "baseline", "-fstrip"]
    _zig(["build-lib", *options, str(_HERE / "elementary.zig")], target)


def zig_library() -> Path:
    """Return the folder of the compiler's own sources, musl among them.

    Raises:
        UserError: If the extra `page` isn't installed.
    """
    try:
        import ziglang  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UserError("building the page's core needs: pip install 'socialiq[page]'") from error
    return Path(ziglang.__file__).parent / "lib"


def _zig(words: list[str], target: Path) -> None:
    """Run the compiler on what is named and on musl's power function."""
    library = zig_library()
    places = [f"-I{library / 'libc' / name}" for name in _HEADERS]
    places += [f"-I{library / 'libc' / 'include' / name}" for name in _GENERATED]
    flags = ["-cflags", "-std=c99", "-ffp-contract=off", "-frounding-math", "-w", "--"]
    power = [str(library / "libc" / "musl" / "src" / "math" / f"{name}.c") for name in _POWER]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / target.name
        call = [sys.executable, "-m", "ziglang", *words, *places, *flags, *power]
        done = subprocess.run(
            [*call, f"-femit-bin={out}"], cwd=folder, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise UserError(f"the linker failed: {done.stderr.strip()}")
        target.write_bytes(out.read_bytes())
