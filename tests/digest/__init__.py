"""Digest of results: a SHA-256 for each table, which shows whether a number has changed.

`python -m tests.digest --make` writes `digest.json`, `--compare` computes it again.
"""

import os

FLAGS = "--xla_cpu_use_fusion_emitters=false --xla_cpu_max_isa=AVX2"


def set_environment() -> None:
    """Set what `tests/conftest.py` and the Makefile set, so that every way to run gives one hash.

    JAX and NumPy read these variables when they are imported, so this package must be imported
    before them; both then do without AVX-512, which not every processor has, and NumPy multiplies
    matrices alike. NPROC is XLA's number of threads, on which the order of its sums depends. Under
    pytest `tests/conftest.py` and its fixtures set the same.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if FLAGS not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {FLAGS}"
    for name, value in {
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "1",
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
        "NPROC": "1",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_CORETYPE": "Haswell",
    }.items():
        os.environ.setdefault(name, value)


set_environment()
