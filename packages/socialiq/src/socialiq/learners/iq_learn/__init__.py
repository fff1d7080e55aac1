"""Social Impact Regularized IQ-Learn (thesis chapters 2 and 4, appendix B)."""
