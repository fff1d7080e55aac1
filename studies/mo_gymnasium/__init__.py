"""Dials on MO-Gymnasium's tasks, beside methods of morl-baselines."""
