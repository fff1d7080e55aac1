"""The compiled core as WebAssembly, built from the same Numba source."""
