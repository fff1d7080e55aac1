"""The study `classic-control`."""
