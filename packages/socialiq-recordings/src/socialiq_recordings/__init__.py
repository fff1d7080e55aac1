"""Recorded traffic: tracks on a road network, converted to demonstrations."""
