"""The study `lambda-sweep`."""
