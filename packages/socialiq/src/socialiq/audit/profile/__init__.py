"""Declarations: fields, reader, template, and the scenario that a declaration names."""
