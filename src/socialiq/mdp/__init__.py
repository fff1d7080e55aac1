"""Exact finite MDPs: value iteration, evaluation, occupancy and the attainable reward pairs."""
