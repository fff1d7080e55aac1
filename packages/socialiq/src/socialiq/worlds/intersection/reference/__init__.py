"""Real highway-env, and the comparison of the core with it."""
