"""Sweeps: many trainings that a TOML file names, as jobs of the engine."""
