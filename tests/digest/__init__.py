"""Digest of results: a SHA-256 for each table, which shows whether a number has changed.

`python -m tests.digest --make` writes `digest.json`, `--compare` computes it again.
"""

import os

FLAGS = "--xla_cpu_use_fusion_emitters=false --xla_cpu_max_isa=AVX2"


def set_environment() -> None:
    """Set what `tests/conftest.py` and the Makefile set, so that every way to run gives one hash.

    JAX and NumPy read these variables when they are imported, so this package must be imported
    before them; NumPy then multiplies matrices alike on every processor, and XLA compiles without
    AVX-512, which not every processor has. Under pytest `tests/conftest.py` and its fixtures set
    the same.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if FLAGS not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {FLAGS}"
    for name, value in {
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "1",
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_CORETYPE": "Haswell",
    }.items():
        os.environ.setdefault(name, value)


set_environment()
