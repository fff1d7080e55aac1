"""Road networks of recordings: lanelets, conflict areas, paths and routes."""
