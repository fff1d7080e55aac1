"""Pictures of a study's results, drawn from its tables alone."""
