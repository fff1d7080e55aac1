"""Interface of a driver: the observation's rows and the three actions."""

from __future__ import annotations

ACTIONS = ("slower", "idle", "faster")
"""Actions: one target speed down, keep, one up, counted from the present speed."""

SLOWER, IDLE, FASTER = range(len(ACTIONS))

FEATURES = ("presence", "x", "y", "vx", "vy", "cos_h", "sin_h")
"""Numbers of one row of the observation."""

POSITION_RANGE = 100.0  # m, seen as 1
SPEED_RANGE = 20.0  # m/s, seen as 1
