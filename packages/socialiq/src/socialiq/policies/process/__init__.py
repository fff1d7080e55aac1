"""Policies in separate processes, with limits."""
