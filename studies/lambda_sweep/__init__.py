"""The sweep of the regularization strength (thesis appendix D, Figs D.1 and D.2)."""
