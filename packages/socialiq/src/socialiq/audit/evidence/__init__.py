"""Evidence of an audit: seeded episodes of the policy and its references."""
