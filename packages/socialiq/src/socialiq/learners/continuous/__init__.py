"""Learners of continuous actions: an actor, a squashed Gaussian, and twin critics."""
