"""Compiled core of roads with several lanes: every scene runs through the same kernels."""
