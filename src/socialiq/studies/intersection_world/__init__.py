"""The study `intersection-world`."""
