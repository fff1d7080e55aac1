"""Pictures and films of the crossing, from its state records."""
