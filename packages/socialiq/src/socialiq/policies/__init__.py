"""Untrusted policies of other programs in, our own policies out (docs/policies.md)."""
