"""Many drivers with different angles: games, fleets, norms, stakeholders (thesis 9.3 to 9.5)."""
