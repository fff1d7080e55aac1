"""SUMO as a second simulator: a network, its traffic, and an ego that our policies drive."""
