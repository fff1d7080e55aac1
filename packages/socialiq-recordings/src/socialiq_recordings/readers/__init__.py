"""Readers of recorded traffic: CommonRoad XML, and CSV by column maps."""
