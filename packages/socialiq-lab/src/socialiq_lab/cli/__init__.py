"""Commands of the laboratory: studies, comparisons, claims, sweeps, benchmarks."""
