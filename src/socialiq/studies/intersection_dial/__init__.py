"""The dial in the intersection, beside agents trained for one angle each."""
