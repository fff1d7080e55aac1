"""Jobs, tables and pictures that the studies of the intersection share."""
