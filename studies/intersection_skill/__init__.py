"""A skill that demonstrators share and the reward pair lacks."""
