"""Statements and predictions of the theory against exact minima and trained networks."""
