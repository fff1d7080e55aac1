"""Recorded junctions as environments: reactive traffic on the recorded road."""
