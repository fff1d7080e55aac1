"""Contrast of the page's colours, by WCAG 2.2: 4.5 for text, 3 for what is drawn."""

import re

import pytest

from socialiq.page.write import ASSETS

TEXT = [
    *[(ink, ground) for ink in ("ink", "faint") for ground in ("paper", "card", "soft")],
    ("on-accent", "accent"),
    *[("on-ego", f"twin-{place}") for place in range(3)],
    *[(f"twin-{place}", ground) for place in range(3) for ground in ("soft", "card")],
]
DRAWN = [
    *[(f"twin-{place}", ground) for place in range(3) for ground in ("road", "card")],
    *[(mark, "road") for mark in ("alarm", "yields", "ghost")],
    ("focus", "paper"),
    ("focus", "card"),
]


def schemes():
    """Colours by name, of the light and of the dark scheme."""
    blocks = re.findall(r":root \{(.*?)\}", (ASSETS / "style.css").read_text(), re.S)
    light, dark = (dict(re.findall(r"--([\w-]+): (#\w{6})", block)) for block in blocks)
    return {"light": light, "dark": dark}


def luminance(colour):
    parts = [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    linear = [
        part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_black_on_white_is_21():
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_is_enough(scheme):
    colours = schemes()[scheme]
    low = [
        (one, other, round(contrast(colours[one], colours[other]), 2))
        for pairs, least in ((TEXT, 4.5), (DRAWN, 3.0))
        for one, other in pairs
        if contrast(colours[one], colours[other]) < least
    ]
    assert low == []


def mixed(above, below, share):
    parts = [[int(one[place : place + 2], 16) for place in (1, 3, 5)] for one in (above, below)]
    values = [round(share * a + (1 - share) * b) for a, b in zip(*parts, strict=True)]
    return "#" + "".join(f"{value:02x}" for value in values)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("above", ["twin-0", "other"])
def test_numbers_of_visits_can_be_read(scheme, above):
    (fullest,) = re.findall(r"FULLEST = ([\d.]+)", (ASSETS / "crossing.js").read_text())
    colours = schemes()[scheme]
    ground = mixed(colours[above], colours["road"], float(fullest))
    assert contrast(colours["ink"], ground) >= 4.5
