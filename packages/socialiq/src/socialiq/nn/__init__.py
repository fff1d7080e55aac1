"""Networks as frozen data, and trained networks as policies."""
