"""Conflicts of recorded vehicles: areas, arrival times and published measures."""
