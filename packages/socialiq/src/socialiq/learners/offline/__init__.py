"""Offline dial: behaviour-regularised vector Q-learning from demonstrations and their rewards."""
