"""Study `intersection-offline`: one dial from demonstrations and their reward pairs alone."""
