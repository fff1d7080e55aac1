"""Building the core: its entry point, compiled by Numba and linked by Zig's compiler.

The wheel `ziglang` (extra `page`) holds the linker.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba import types
from numba.np.numpy_support import carray

from socialiq.errors import UserError
from socialiq.page.webassembly.layout import ARGUMENTS
from socialiq.worlds.highway.core import step
from socialiq.worlds.highway.crossings import Crossings
from socialiq.worlds.highway.options import FEATURES, SIGNALS, Buffers
from socialiq.worlds.highway.scenes import Road
from socialiq.worlds.intersection.core.geometry import ROAD
from socialiq.worlds.intersection.options import Options, buffers_of


def entry_of(options: Options) -> Callable[..., None]:
    """Return the function to compile: pointers to arrays, with the options' sub-steps."""
    # Not from the cache of the native one.
    run: Any = numba.njit(step.run.py_func, error_model="numpy")
    frames = options.frames
    signals_of = len(SIGNALS)
    features = len(FEATURES)
    # A compiled function takes arrays as constants, and no tuple of them.
    lanes, successors, routes, connected, entries = ROAD[:5]
    arrivals, turns, obstacles, changes, sight = ROAD[5:10]
    ways, crosswalks, meetings, ridden = ROAD.crossings

    def entry(
        episodes, vehicles, people, influences, before, after, present, reached, observation,
        signals, rewards, classical, speed, ending, contact, neighbours_collided, braking, trace,
        people_trace, commands, entropy, seeded, actions, settings, rows, traced, agents, capacity,
        persons, observed,
    ):  # fmt: skip
        seen = rows * agents, observed, features
        buffers = Buffers(
            carray(episodes, (rows,)),
            carray(vehicles, (rows, capacity)),
            carray(people, (rows, persons)),
            carray(influences, (rows, agents, persons)),
            carray(before, (rows, capacity)),
            carray(after, (rows, capacity)),
            carray(present, (rows, 1 + agents)),
            carray(reached, seen),
            carray(observation, seen),
            carray(signals, (rows * agents, signals_of)),
            carray(rewards, (rows * agents, 2)),
            carray(classical, (rows * agents, 2)),
            carray(speed, (rows * agents,)),
            carray(ending, (rows * agents,)),
            carray(contact, (rows * agents,)),
            carray(neighbours_collided, (rows * agents,)),
            carray(braking, (rows * agents, capacity)),
            carray(trace, (traced, frames, capacity)),
            carray(people_trace, (traced, frames, persons)),
        )
        inputs = carray(commands, (rows,)), carray(entropy, (rows,)), carray(seeded, (rows,))
        road = Road(
            lanes, successors, routes, connected,
            entries, arrivals, turns, obstacles, changes, sight,
            Crossings(ways, crosswalks, meetings, ridden),
        )  # fmt: skip
        chosen = carray(actions, (rows * agents,))
        run(buffers, *inputs, chosen, carray(settings, (1,)), road, 0, rows)

    return entry


SYMBOL = "step_rows"
"""Name of the entry point in the object file. Numba's convention: it returns a status, 0 for
success, and its first two arguments are places for a result and an exception."""

DATA_LAYOUT = "e-m:e-p:32:32-p10:8:8-p20:8:8-i64:64-i128:128-n32:64-S128-ni:1:10:20"
TRIPLE = "wasm32-unknown-unknown"
_TARGET_FEATURES = "+bulk-memory,+nontrapping-fptoint,+sign-ext,+mutable-globals"

_UNOPTIMISED = {"NUMBA_OPT": "0", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}


def object_file(path: Path) -> None:
    """Write the object file, in a separate process, since Numba reads its settings at import."""
    subprocess.run(
        [sys.executable, "-m", __name__, str(path)], env=os.environ | _UNOPTIMISED, check=True
    )


def intermediate() -> str:
    """Return the unoptimised LLVM code of the entry point and all that it calls."""
    arrays = [array.dtype for array in buffers_of(Options(), 1, traced=True)]
    pointers = [types.CPointer(numba.from_dtype(array)) for array in (*arrays, *ARGUMENTS.values())]
    signature = types.void(*pointers, *6 * [types.int32])  # numbers, as of `layout.ARGUMENTS`
    plain = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    compiled = numba.njit(signature, **plain)(entry_of(Options()))
    (result,) = compiled.overloads.values()
    return result.library.get_llvm_str().replace(result.fndesc.llvm_func_name, SYMBOL)


def compiled(code: str) -> bytes:
    """Return the object file of LLVM code, of which the entry point alone is visible outside.

    WebAssembly's data layout takes the place of the machine's.
    """
    import llvmlite.binding as llvm

    code = re.sub(r"^target (datalayout|triple).*$", "", code, flags=re.M)
    code = f'target datalayout = "{DATA_LAYOUT}"\ntarget triple = "{TRIPLE}"\n{code}'
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    module = llvm.parse_assembly(code)
    for symbol in (*module.functions, *module.global_variables):
        if not symbol.is_declaration and symbol.name != SYMBOL:
            symbol.linkage = "internal"
    target = llvm.Target.from_triple(TRIPLE)
    machine = target.create_target_machine(opt=3, features=_TARGET_FEATURES)
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = False
    builder = llvm.create_pass_builder(machine, options)
    for _ in range(2):
        pruning = llvm.create_new_module_pass_manager()
        pruning.add_refprune_pass()
        builder.getModulePassManager().run(module, builder)
        pruning.run(module, builder)
    return machine.emit_object(module)


if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(compiled(intermediate()))


EXPORTS = (SYMBOL, "allocate", "memory")
"""Names that a program which loads the file can use."""

_HERE = Path(__file__).parent
_POWER = ("pow", "pow_data", "exp_data")
_POWER += tuple(f"__math_{name}" for name in ("invalid", "oflow", "uflow", "xflow"))
_HEADERS = ("musl/src/include", "musl/src/internal", "musl/include", "musl/arch/generic")
_GENERATED = ("wasm-wasi-musl", "generic-musl")


def linked(core: Path, target: Path) -> None:
    """Write the WebAssembly file of an object file of `object_file`; it has no imports.

    Args:
        core: The object file.
        target: File to write.

    Raises:
        UserError: If the extra `page` isn't installed, or the linker fails.
    """
    options = ["-target", "wasm32-freestanding", "-O", "ReleaseSmall", "-fno-entry", "-fstrip"]
    options += [f"--export={name}" for name in EXPORTS if name != "memory"]
    _zig(["build-exe", *options, str(core), str(_HERE / "runtime.zig")], target)


def elementary_functions(folder: Path) -> str:
    """Write shared libraries of this machine with the elementary functions of the page.

    Returns:
        The value of LD_PRELOAD with which a program calls them in the place of its usual ones.

    Raises:
        UserError: As `linked`.
    """
    functions = folder / "libelementary.so"
    names = folder / "libnames.so"
    plain = ["-mcpu", "baseline", "-fstrip", "-O", "ReleaseFast"]
    _zig(["build-lib", "-dynamic", *plain, str(_HERE / "elementary.zig")], functions)
    flags = ["-shared", "-nostdlib", "-fno-builtin", "-O2", f"-Wl,-rpath,{folder}"]
    _run("cc", *flags, str(_HERE / "names.c"), str(functions), "-o", str(names))
    return f"{names}:{functions}"


def _zig_library() -> Path:
    """Return the folder of the compiler's own sources, musl among them."""
    try:
        import ziglang  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UserError("building the page's core needs: pip install 'socialiq[page]'") from error
    return Path(str(ziglang.__file__)).parent / "lib"


def _zig(words: list[str], target: Path) -> None:
    """Run the compiler on what is named and on musl's power function."""
    library = _zig_library()
    places = [f"-I{library / 'libc' / name}" for name in _HEADERS]
    places += [f"-I{library / 'libc' / 'include' / name}" for name in _GENERATED]
    flags = ["-cflags", "-std=c99", "-ffp-contract=off", "-frounding-math", "-w", "--"]
    power = [str(library / "libc" / "musl" / "src" / "math" / f"{name}.c") for name in _POWER]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / target.name
        _run(*words, *places, *flags, *power, f"-femit-bin={out}", folder=folder)
        target.write_bytes(out.read_bytes())


def _run(*words: str, folder: str | None = None) -> None:
    _zig_library()
    done = subprocess.run(
        [sys.executable, "-m", "ziglang", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise UserError(f"the linker failed: {done.stderr.strip()[:1000]}")
