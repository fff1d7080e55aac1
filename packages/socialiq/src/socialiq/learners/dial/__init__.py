"""The dial: one soft Q-network for every social angle, steered to where the angle points."""
