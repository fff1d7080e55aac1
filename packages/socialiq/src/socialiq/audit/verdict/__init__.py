"""Tests of the evidence against the declaration, and the verdict that joins them."""
