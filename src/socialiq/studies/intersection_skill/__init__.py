"""A hidden skill in the intersection: what demonstrations add to RL on the reward pair."""
