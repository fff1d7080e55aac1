"""Experiments: studies as jobs, the engine that runs them, their results and the claims ledger."""
