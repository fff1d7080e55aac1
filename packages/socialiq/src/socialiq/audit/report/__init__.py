"""The report of an audit: one JSON document, the views made from it, manifest and statement."""
