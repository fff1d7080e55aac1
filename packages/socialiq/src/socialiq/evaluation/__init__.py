"""Evaluation of policies: rollouts, exact evaluation, metrics, regret."""
