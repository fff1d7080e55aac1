"""The social angle as a trait: inferred from some decisions of a driver, tested on others."""
