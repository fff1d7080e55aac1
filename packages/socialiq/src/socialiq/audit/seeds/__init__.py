"""Seeds that come after the commitment: their sources, and what each is worth."""
