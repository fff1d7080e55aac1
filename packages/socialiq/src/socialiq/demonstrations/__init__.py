"""Demonstrations: the columnar table, how demonstrators are mixed into one, and its files."""
