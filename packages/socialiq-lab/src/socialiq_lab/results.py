"""Results folders by their name in the laboratory; `socialiq.results_folder` has them."""

from socialiq.results_folder import (
    LIBRARIES,
    Results,
    as_csv,
    check_target,
    from_csv,
    load,
    save,
    versions,
)
from socialiq.to_json import rounded

__all__ = [
    "LIBRARIES",
    "Results",
    "as_csv",
    "check_target",
    "from_csv",
    "load",
    "rounded",
    "save",
    "versions",
]
