"""Commands of the laboratory, which `socialiq` finds by an entry point."""

COMMANDS = {
    "demo": "socialiq_lab.cli.demo:Demo",
    "sweep": "socialiq_lab.cli.sweep:Sweep",
    "reproduce": "socialiq_lab.cli.studies:Reproduce",
    "claims": "socialiq_lab.cli.claims:Claims",
    "bench": "socialiq_lab.cli.bench:Bench",
}
"""Module and class of each command."""
