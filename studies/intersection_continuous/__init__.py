"""The intersection with continuous actions: experts, learners from a mixture, dials."""
