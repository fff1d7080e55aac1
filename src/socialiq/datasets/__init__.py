"""Data sets of other programs as demonstrations, and demonstrations as theirs."""
