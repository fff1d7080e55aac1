"""Reliability of an audit's numbers."""
