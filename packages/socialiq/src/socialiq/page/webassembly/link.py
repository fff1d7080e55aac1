"""Linking by Zig's compiler, which the wheel `ziglang` holds (extra `page`)."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from socialiq.errors import UserError
from socialiq.page.webassembly.emit import SYMBOL

EXPORTS = (SYMBOL, "allocate", "memory")
"""Names that a program which loads the file can use."""

_HERE = Path(__file__).parent
_POWER = (
    "pow",
    "pow_data",
    "exp_data",
    "__math_invalid",
    "__math_oflow",
    "__math_uflow",
    "__math_xflow",
)
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


def elementary_functions(folder: Path) -> str:
    """Write shared libraries of this machine with the elementary functions of the page.

    Args:
        folder: Where to write them.

    Returns:
        The value of LD_PRELOAD with which a program calls them in the place of its own.

    Raises:
        UserError: As `linked`.
    """
    functions, names = folder / "libelementary.so", folder / "libnames.so"
    plain = ["-mcpu", "baseline", "-fstrip", "-O", "ReleaseFast"]
    _zig(["build-lib", "-dynamic", *plain, str(_HERE / "elementary.zig")], functions)
    flags = ["-shared", "-nostdlib", "-fno-builtin", "-O2", f"-Wl,-rpath,{folder}"]
    _run("cc", *flags, str(_HERE / "names.c"), str(functions), "-o", str(names))
    return f"{names}:{functions}"


def zig_library() -> Path:
    """Return the folder of the compiler's own sources, musl among them.

    Raises:
        UserError: If the extra `page` isn't installed.
    """
    try:
        import ziglang  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UserError("building the page's core needs: pip install 'socialiq[page]'") from error
    return Path(str(ziglang.__file__)).parent / "lib"


def _zig(words: list[str], target: Path) -> None:
    """Run the compiler on what is named and on musl's power function."""
    library = zig_library()
    places = [f"-I{library / 'libc' / name}" for name in _HEADERS]
    places += [f"-I{library / 'libc' / 'include' / name}" for name in _GENERATED]
    flags = ["-cflags", "-std=c99", "-ffp-contract=off", "-frounding-math", "-w", "--"]
    power = [str(library / "libc" / "musl" / "src" / "math" / f"{name}.c") for name in _POWER]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / target.name
        _run(*words, *places, *flags, *power, f"-femit-bin={out}", folder=folder)
        target.write_bytes(out.read_bytes())


def _run(*words: str, folder: str | None = None) -> None:
    zig_library()
    done = subprocess.run(
        [sys.executable, "-m", "ziglang", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise UserError(f"the linker failed: {done.stderr.strip()[:1000]}")
