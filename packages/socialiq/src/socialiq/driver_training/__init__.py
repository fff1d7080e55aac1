"""The driver: one dial for every road, every road user and every angle."""
