"""Recorded vehicles as episodes of the simulator."""
