"""Many drivers with angles of their own: games, fleets, norms, stakeholders (thesis 9.3 to 9.5)."""
