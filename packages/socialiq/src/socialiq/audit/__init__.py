"""Audit: test whether a policy behaves as its owner declared, from its episodes alone."""
