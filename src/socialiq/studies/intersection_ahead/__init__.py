"""The study `intersection-ahead`."""
