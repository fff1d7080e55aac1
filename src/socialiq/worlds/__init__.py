"""Environments: each world's rules and rewards are written once, and everything else is derived."""
