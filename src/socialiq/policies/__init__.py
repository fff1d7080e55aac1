"""Policies that were made elsewhere, brought under audit without trust (docs/policies.md)."""
