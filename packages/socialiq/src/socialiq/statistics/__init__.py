"""Statistics: intervals, bounds, bootstrap, tests; arrays in, numbers out."""
