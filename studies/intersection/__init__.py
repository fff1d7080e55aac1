"""Experts, demonstrations and learners of the intersection."""
