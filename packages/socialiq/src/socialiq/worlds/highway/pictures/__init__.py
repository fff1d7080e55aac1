"""Pictures and films of roads, from their state records."""
