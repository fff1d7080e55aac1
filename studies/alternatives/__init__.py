"""Alternative places of the prior (thesis appendix B), trained in the 7x7 world."""
