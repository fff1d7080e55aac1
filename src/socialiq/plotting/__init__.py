"""Plotting shared by all figures: style, ring of angles, bands over seeds."""
