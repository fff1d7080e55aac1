"""Printed values of the thesis for the intersection: Tables 6.1, 6.2, A.1, A.2, Fig 6.5."""

import tomllib
from pathlib import Path

_PRINTED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())

METRICS = tuple(_PRINTED["metrics"])
POLICIES = tuple(_PRINTED["policies"])
"""Rows of Tables 6.1 and 6.2, and columns of Table 6.2."""

TABLE_6_2 = {
    metric: dict(zip(POLICIES, map(tuple, values), strict=True))
    for metric, values in _PRINTED["table_6_2"].items()
}
"""Mean and spread over five evaluation seeds, by metric and policy."""

TABLE_A_1 = _PRINTED["table_a_1"]
"""Mean and standard deviation of each return over episodes, by mode."""

TABLE_A_2 = {tuple(pair.split()): values for pair, values in _PRINTED["table_a_2"].items()}
"""Cohen's d of each return between two modes."""

FIG_6_5 = _PRINTED["fig_6_5"]
"""Empirical angles in degrees, by target."""
