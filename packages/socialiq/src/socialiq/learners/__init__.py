"""Algorithms that turn demonstrations into policies."""
