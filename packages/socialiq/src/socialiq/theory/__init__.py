"""Exact analysis of the regularized objective: closed forms and a reliable minimiser."""
