"""The social angle as a trait of a driver: inferred from some of its decisions, tested on others."""
