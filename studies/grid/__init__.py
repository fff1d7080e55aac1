"""The 7x7 study (thesis 6.2, Figs 6.2-6.4)."""
