"""Recorded traffic: tracks on a road network, driven again as demonstrations."""
