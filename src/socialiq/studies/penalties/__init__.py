"""The study `penalties`."""
