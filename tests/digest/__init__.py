"""Digest of results: a SHA-256 for each table, which shows whether a number has changed.

`python -m tests.digest --make` writes `digest.json`, `--compare` computes it again.
"""

import os

FLAGS = (
    "--xla_cpu_use_fusion_emitters=false --xla_cpu_max_isa=AVX"
    " --xla_cpu_experimental_ynn_fusion_type="
)


def set_environment() -> None:
    """Set what `tests/conftest.py` and the Makefile set, so that every way to run gives one hash.

    JAX and NumPy read these variables when they are imported, so this package must be imported
    before them. Both then do without AVX-512, and JAX without YNNPACK and oneDNN, which multiply
    matrices by other instructions on other processors. With these settings a training of
    `nn.regression` gave the same bits on a Sapphire Rapids and in an emulated EPYC-Rome (QEMU);
    with the instruction set alone, or without YNNPACK alone, it did not. NPROC is XLA's number of
    threads, on which the order of its sums depends. Under pytest `tests/conftest.py` and its
    fixtures set the same.
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
        "TENSORFLOW_USE_CUSTOM_CONTRACTION_KERNEL": "false",
    }.items():
        os.environ.setdefault(name, value)


set_environment()
