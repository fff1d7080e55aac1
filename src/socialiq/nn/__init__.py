"""Networks as plain frozen data, and trained networks as policies."""
