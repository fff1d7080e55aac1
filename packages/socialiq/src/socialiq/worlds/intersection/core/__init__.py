"""Compiled core: highway-env's model of the crossing, kernel by kernel."""
