"""The study `alternatives`."""
