"""Social angle: the score of two rewards at an angle, and the angle of behaviour."""
