"""The core as an object file for WebAssembly: Numba gives LLVM's code, its back end the file.

Numba knows the machine it runs on alone. Its code is taken before any optimisation, given
WebAssembly's data layout, and optimised for that target. Arithmetic stays strict: no pass may
rewrite it.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

SYMBOL = "step_rows"
"""Name of the entry point in the object file. Numba's convention: it returns a status, 0 for
success, and its first two arguments are places for a result and an exception."""

DATA_LAYOUT = "e-m:e-p:32:32-p10:8:8-p20:8:8-i64:64-i128:128-n32:64-S128-ni:1:10:20"
TRIPLE = "wasm32-unknown-unknown"
FEATURES = "+bulk-memory,+nontrapping-fptoint,+sign-ext,+mutable-globals"

_UNOPTIMISED = {"NUMBA_OPT": "0", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}


def object_file(path: Path) -> None:
    """Write the object file, in a process of its own, since Numba reads its settings at import.

    Args:
        path: The file; its folder must exist.
    """
    subprocess.run(
        [sys.executable, "-m", __name__, str(path)], env=os.environ | _UNOPTIMISED, check=True
    )


def intermediate() -> str:
    """Return the unoptimised LLVM code of the entry point and all that it calls."""
    import numba

    from socialiq.page.webassembly.entry import entry_of, signature_of
    from socialiq.worlds.intersection.options import Options

    signature = signature_of(Options())
    plain = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    compiled = numba.njit(signature, **plain)(entry_of(Options()))
    (result,) = compiled.overloads.values()
    return result.library.get_llvm_str().replace(result.fndesc.llvm_func_name, SYMBOL)


def retargeted(code: str) -> str:
    """Return the code with WebAssembly's data layout in the place of the machine's."""
    code = re.sub(r"^target (datalayout|triple).*$", "", code, flags=re.M)
    return f'target datalayout = "{DATA_LAYOUT}"\ntarget triple = "{TRIPLE}"\n{code}'


def compiled(code: str) -> bytes:
    """Return the object file of retargeted code; only the entry point is visible outside."""
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    module = llvm.parse_assembly(code)
    for symbol in (*module.functions, *module.global_variables):
        if not symbol.is_declaration and symbol.name != SYMBOL:
            symbol.linkage = "internal"
    target = llvm.Target.from_triple(TRIPLE)
    machine = target.create_target_machine(opt=3, features=FEATURES)
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
    Path(sys.argv[1]).write_bytes(compiled(retargeted(intermediate())))
