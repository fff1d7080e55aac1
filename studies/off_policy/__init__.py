"""Off-policy evaluation beside exact values: how often its intervals hold, and when it says no."""
