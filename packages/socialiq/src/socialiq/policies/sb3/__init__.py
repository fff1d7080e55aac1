"""Policies of Stable-Baselines3, read without running their pickles."""
