"""The study `grid`."""
