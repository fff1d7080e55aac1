"""The audit: whether a policy behaves as its owner declared, judged from its episodes alone."""
