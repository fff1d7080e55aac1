"""The report of an audit: one JSON document, the views made from it, and its seals."""
