"""crossing7, the stochastic 7x7 intersection with reactive traffic (thesis 5.1.2)."""

from socialiq.worlds.crossing7.options import Options
from socialiq.worlds.crossing7.world import make

__all__ = ["Options", "make"]
