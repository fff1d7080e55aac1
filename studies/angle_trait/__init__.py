"""Planted angles in simulated traffic."""
