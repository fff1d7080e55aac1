"""Audits of the thesis' printed tables and of this project's policies."""
