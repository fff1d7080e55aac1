"""The theory held against exact minima and against trained networks."""
