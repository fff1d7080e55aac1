"""Roads of highway-env, compiled, with identical episodes; `scenes` has most of them."""

PORTABLE = {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL", "OPENBLAS_CORETYPE": "Haswell"}
"""Environment variables with which NumPy, and so highway-env, computes as the core does.

They matter on processors with AVX-512. The first selects the C library's functions, the second the
order of summation of the AVX2 kernels in products of small matrices. They must be set before the
process starts.
"""
