"""Off-policy evaluation: the returns of a policy from episodes that others drove."""
