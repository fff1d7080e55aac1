"""Prediction of recorded drivers: models of their next acceleration, and the choices they had."""
