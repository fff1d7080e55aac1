"""Printed values of the thesis for the intersection: Tables 6.1, 6.2, A.1, A.2, Fig 6.5."""

METRICS = ("collision", "arrival", "timeout", "speed_kmh", "stopped")
"""Rows of Tables 6.1 and 6.2; rates and the share stopped in %, speed in km/h."""

POLICIES = ("expert egoistic", "egoistic", "expert prosocial", "prosocial", "expert altruistic",
            "altruistic", "baseline")  # fmt: skip
"""Columns of Table 6.2; those without "expert" are learners, by target."""

TABLE_6_2: dict[str, dict[str, tuple[float, float]]] = {
    "collision": dict(zip(POLICIES, [(29, 5.4), (29, 4.0), (25, 1.5), (23, 2.5), (29, 3.1),
                                     (11, 1.7), (18.0, 2.6)], strict=True)),
    "arrival": dict(zip(POLICIES, [(70, 5.3), (55, 3.3), (54, 2.7), (46, 1.7), (0, 0.0),
                                   (1, 1.2), (23.6, 1.4)], strict=True)),
    "timeout": dict(zip(POLICIES, [(1, 0.4), (16, 2.3), (21, 3.9), (32, 1.7), (71, 3.1),
                                   (88, 1.9), (58.4, 2.0)], strict=True)),
    "speed_kmh": dict(zip(POLICIES, [(28, 0.3), (20, 0.6), (16, 0.2), (16, 0.3), (5.8, 0.1),
                                     (3.8, 0.3), (10.2, 0.4)], strict=True)),
    "stopped": dict(zip(POLICIES, [(2, 0.3), (21, 1.6), (33, 0.6), (33, 1.3), (62, 1.0),
                                   (71, 1.8), (51.5, 1.0)], strict=True)),
}  # fmt: skip
"""Mean and spread over five evaluation seeds, by metric and policy."""

TABLE_A_1: dict[str, dict[str, tuple[float, float]]] = {
    "egoistic": {"g_self": (8.17, 3.45), "g_global": (7.00, 3.93),
                 "g_env": (7.13, 3.26), "g_social": (-2.00, 4.84)},
    "prosocial": {"g_self": (6.76, 3.58), "g_global": (12.16, 4.81),
                  "g_env": (4.88, 3.44), "g_social": (0.68, 6.75)},
    "altruistic": {"g_self": (2.47, 1.24), "g_global": (12.24, 4.99),
                   "g_env": (0.01, 0.96), "g_social": (1.76, 5.51)},
}  # fmt: skip
"""Mean and standard deviation over episodes: classical self and global, r_env and r_social."""

TABLE_A_2: dict[tuple[str, str], dict[str, float]] = {
    ("egoistic", "prosocial"): {"g_env": 0.67, "g_global": -1.17, "g_social": -0.46},
    ("prosocial", "altruistic"): {"g_env": 1.93, "g_global": -0.02, "g_social": -0.17},
    ("egoistic", "altruistic"): {"g_env": 2.96, "g_global": -1.16, "g_social": -0.72},
}
"""Cohen's d between modes. What its heading calls G_self follows from Table A.1's G_env alone:
the column of classical G_self would give 0.40, 1.60 and 2.20."""

FIG_6_5 = {"egoistic": 0.0, "prosocial": 30.0, "altruistic": 131.0}
"""Empirical angles in degrees; the baseline's is only drawn, near the prosocial one."""
