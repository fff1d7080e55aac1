"""Direct policy iteration from rollouts of every action (Lazaric et al. 2016)."""
