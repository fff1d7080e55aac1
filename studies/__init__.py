"""Studies: what to run, which tables and figures follow. In no wheel; `socialiq_lab` runs them."""
