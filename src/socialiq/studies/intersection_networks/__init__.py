"""The study `intersection-networks`."""
