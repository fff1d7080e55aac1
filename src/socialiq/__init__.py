"""Driving policies of a declared social angle, learned from mixed demonstrations."""
