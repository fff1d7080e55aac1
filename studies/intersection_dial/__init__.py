"""The dial in the intersection, beside agents of one angle each and dials of other recipes."""
