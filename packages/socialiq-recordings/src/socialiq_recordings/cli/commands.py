"""Commands on recorded traffic, which `socialiq` finds by an entry point."""

COMMANDS = {
    "data import": "socialiq_recordings.cli.recordings:Import",
    "data inspect": "socialiq_recordings.cli.recorded_inspect:Inspect",
    "data demonstrations": "socialiq_recordings.cli.recorded:ToDemonstrations",
    "data census": "socialiq_recordings.cli.recorded:TakeCensus",
    "data decisions": "socialiq_recordings.cli.recorded_decisions:Decide",
    "data conflicts": "socialiq_recordings.cli.recorded_conflicts:FindConflicts",
    "data world": "socialiq_recordings.cli.recorded_world:MakeWorld",
    "data predict": "socialiq_recordings.cli.recorded_prediction:Predict",
    "data power": "socialiq_recordings.cli.recorded_power:Power",
    "data agreement": "socialiq_recordings.cli.recorded:Agreement",
    "data audit": "socialiq_recordings.cli.recorded_audit:AuditRecorded",
}
"""Module and class of each command."""
