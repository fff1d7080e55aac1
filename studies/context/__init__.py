"""Angles that depend on the situation, beside constant ones."""
