"""Looks: every commitment in an audit log, and the share of the error that each may spend."""
