"""Commands on recorded traffic, which `socialiq` finds by an entry point."""

COMMANDS = {
    "data import": "socialiq_recordings.cli.files:Import",
    "data inspect": "socialiq_recordings.cli.files:Inspect",
    "data conflicts": "socialiq_recordings.cli.conflicts:FindConflicts",
    "data world": "socialiq_recordings.cli.world:MakeWorld",
    "data demonstrations": "socialiq_recordings.cli.world:ToDemonstrations",
    "data census": "socialiq_recordings.cli.world:TakeCensus",
    "train practised-dial": "socialiq_recordings.cli.practised_dial:PractisedDial",
}
"""Module and class of each command."""
