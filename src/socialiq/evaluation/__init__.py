"""What a policy does: rollouts, exact evaluation, metrics, regret."""
