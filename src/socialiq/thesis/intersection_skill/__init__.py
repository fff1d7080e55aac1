"""A hidden skill in the intersection: what demonstrations add beyond the reward pair, with networks."""
