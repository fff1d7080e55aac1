"""L1 and KL in the place of the quadratic prior (thesis 4.3.1), trained in the 7x7 world."""
