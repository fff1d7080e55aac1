"""Demonstrations from and to the formats of other programs: Minari, NumPy, CSV, Parquet."""
