"""highway-env's unsignalised crossing (thesis 5.1.3), compiled, with identical episodes."""

from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import make

__all__ = ["Options", "make"]
