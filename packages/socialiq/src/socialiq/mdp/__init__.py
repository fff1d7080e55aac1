"""Exact finite MDPs: value iteration, evaluation, occupancy and attainable reward pairs."""
