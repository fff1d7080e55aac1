"""Conflicts of recorded vehicles: areas, arrival times, published measures, reasoned influence."""
