"""The real highway-env, and the core held against it."""
