"""Recorded traffic: tracks on a road network, conflicts, a world, demonstrations."""

DISTRIBUTION = "socialiq-recordings"
"""Name of the distribution, whose extras bring the optional libraries."""
