"""Bad calls of the command line, and damaged files for every reader: `python -m tests.fuzz`."""
