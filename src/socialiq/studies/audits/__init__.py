"""Audits of what the thesis published, and of the policies of this project."""
