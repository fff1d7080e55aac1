"""Commands on recorded traffic: `socialiq data ...`."""
