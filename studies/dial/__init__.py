"""The dial in the 7x7 world against the exact optimum of each angle."""
