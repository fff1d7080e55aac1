"""The social angle: how two rewards become one score, and which angle behaviour shows."""
