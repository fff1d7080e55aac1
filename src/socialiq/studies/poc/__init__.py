"""The study `poc`."""
