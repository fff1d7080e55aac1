"""Drivers by name: a policy of the atlas with and without its prefix."""

import pytest

from socialiq.cli.drivers import driver_of
from socialiq.errors import UserError
from socialiq.nn.q_policy import QPolicy
from socialiq.worlds.intersection.world import Intersection


def test_names_of_the_atlas_may_carry_the_prefix_that_audit_uses():
    named, prefixed = (
        driver_of(name, Intersection()).policy for name in ("prosocial", "atlas:prosocial")
    )
    assert isinstance(named, QPolicy) and isinstance(prefixed, QPolicy)
    assert named.sha256 == prefixed.sha256 != ""


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(UserError, match="set_egoistic"):
        driver_of("atlas:prosozial", Intersection())
