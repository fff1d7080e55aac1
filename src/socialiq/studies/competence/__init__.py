"""The benchmark of a hidden skill: what demonstrations add beyond the reward pair."""
