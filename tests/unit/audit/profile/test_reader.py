"""A declaration: written, read back, and refused in one line that names file and line."""

import datetime
import hashlib
import re

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from socialiq.audit.profile.fields import FIELDS
from socialiq.audit.profile.profile import Bound, Floor, Margin
from socialiq.audit.profile.reader import LARGEST_FILE, line_of, load, parse
from socialiq.audit.profile.template import declare
from socialiq.errors import UserError
from socialiq.worlds.intersection.world import Intersection


@pytest.fixture(scope="module")
def text(declared):
    chosen = {"destination": "straight", "target_speeds": (0.0, 5.0, 10.0)}
    return declared("intersection", options=chosen).source.decode()


def complaint(text, name="profile.toml"):
    with pytest.raises(UserError) as caught:
        parse(text if isinstance(text, bytes) else text.encode(), name)
    line = str(caught.value)
    assert "\n" not in line and line.isprintable() and len(line) < 1000
    return line


def changed(text, field, value):
    """The text with another value of a field, and the number of the line."""
    number = line_of(text, field)
    lines = text.split("\n")
    key = lines[number - 1].split("=")[0]
    lines[number - 1] = f"{key}= {value}"
    return "\n".join(lines), number


def test_what_is_written_is_read(text, tmp_path):
    path = tmp_path / "profile.toml"
    path.write_text(text)
    profile = load(path)
    assert (profile.angle, profile.confidence, profile.owner) == (45.0, 0.95, "An owner")
    assert profile.date == datetime.date(2026, 1, 31)
    assert profile.margin == Margin(regret=0.5, degrees=10.0)
    assert profile.competence == Floor(0.05, 0.1, 0.8, 0.2)
    world = profile.world()
    assert isinstance(world, Intersection)
    assert world.options.target_speeds == (0.0, 5.0, 10.0)
    assert profile.sha256 == hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize("largest_loss", [None, 100.0])
def test_every_field_has_its_comment(declared, largest_loss):
    text = declared(margin=Margin(0.5, 10.0, largest_loss)).source.decode()
    words = " ".join(line.lstrip("# ") for line in text.split("\n"))
    for field in FIELDS:
        known = {"margin.degrees"} | ({"margin.largest_loss"} if largest_loss else set())
        assert (field.meaning in words) == (field.required or field.path in known), field.path


def test_the_largest_loss_is_more_than_the_margin(declared):
    profile = declared(margin=Margin(0.5, 10.0, 100.0))
    assert profile.margin.largest_loss == 100.0
    line = complaint(changed(profile.source.decode(), "margin.largest_loss", "0.5")[0])
    assert "margin.largest_loss must be above margin.regret (0.5), got 0.5" in line


def test_one_changed_byte_is_another_declaration(text):
    assert (
        parse(text.encode()).sha256 != parse(text.replace("newcomer", "").encode() + b"\n").sha256
    )


@settings(max_examples=40)
@example(angle=0.0, regret=1.0, owner="'''", day=datetime.date(2000, 1, 1))
@example(angle=0.0, regret=1.0, owner='"#"""\\', day=datetime.date(2000, 1, 1))
@given(
    angle=st.floats(0.0, 360.0, exclude_max=True),
    regret=st.floats(1e-6, 1e6),
    owner=st.text(st.characters(categories=("L", "N", "P")), min_size=1, max_size=200),
    day=st.dates(),
)
def test_any_declaration_survives(angle, regret, owner, day):
    profile = declare(angle, owner, "crossing5", Margin(regret, 5.0), day)
    assert (profile.angle, profile.margin.regret) == (angle, regret)
    assert (profile.owner, profile.date) == (owner, day)
    again = declare(profile.angle, profile.owner, "crossing5", profile.margin, profile.date)
    assert again.source == profile.source


def test_whole_numbers_will_do(text):
    assert parse(changed(text, "angle", "45")[0].encode()).angle == 45.0


@pytest.mark.parametrize("field", [field.path for field in FIELDS if field.required])
def test_a_missing_field_is_named(text, field):
    lines = text.split("\n")
    first = line_of(text, field) - 1
    options = field == "scenario.options"
    del lines[first : lines.index("[competence]") if options else first + 1]
    line = complaint("\n".join(lines))
    assert f"{field} is missing: add " in line
    assert re.match(r"profile\.toml:\d+: ", line)


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("angle", "400", "angle must be a number of at least 0 and below 360, got 400"),
        ("angle", "360.0", "below 360"),
        ("angle", "-0.1", "at least 0"),
        ("angle", "nan", "got nan"),
        ("angle", "inf", "got inf"),
        ("angle", "true", "got True"),
        ("angle", '"45"', "got '45'"),
        ("angle", "0x" + "f" * 1000, "got a huge number"),
        ("angle", "-1" + "0" * 400, "got a huge number"),
        ("angle", "[45]", "got a list"),
        ("angle", "{ a = 1 }", "got a table"),
        ("format", "2", "at most 1"),
        ("confidence", "1.0", "at most 0.9999"),
        ("confidence", "95", "at most 0.9999"),
        ("owner", '""', "visible text"),
        ("owner", '"\\u001b[31mred"', "visible text"),
        ("owner", '"a\\nb"', "visible text"),
        ("owner", '"\\u202egnp.exe"', "visible text"),
        ("owner", '"' + "x" * 201 + '"', "visible text"),
        ("owner", "7", "visible text"),
        ("date", '"2026-01-31"', "without quotes"),
        ("date", "2026-01-31T10:00:00", "a date as 2026-01-31"),
        ("margin.regret", "0", "above 0"),
        ("margin.degrees", "181", "at most 180"),
        ("scenario.world", '"moon"', "one of crossing5, crossing7, crosswalk7"),
        ("reward.sha256", '"abc"', "64 hexadecimal digits"),
        ("reward.sha256", '"' + "A" * 64 + '"', "64 hexadecimal digits"),
        ("reward.sha256", '"' + "0" * 64 + '"', "reward.sha256 is of another world"),
        ("reward.id", '"mine"', "reward.id is of another world"),
        ("scenario.sha256", '"' + "0" * 64 + '"', "scenario.sha256 is of another world"),
        ("competence.min_arrival", "1.1", "at most 1"),
        ("competence.max_struck", "-1", "at least 0"),
        ("scenario.options.destination", '"up"', "destination"),
        ("scenario.options.destination", "1", "destination must be text"),
        ("scenario.options.target_speeds", "[0.0, 9e9]", "within plus or minus 1e+06"),
        ("scenario.options.target_speeds", "9.0", "a list of at most 8 numbers"),
    ],
)
def test_a_bad_field_is_refused_with_its_line(text, field, value, says):
    bad, number = changed(text, field, value)
    line = complaint(bad)
    assert line.startswith(f"profile.toml:{number}: "), line
    assert says in line


DELAY = "max_delay = 6\ndelay_range = [-50, 200]"


def test_bounds_of_effects_are_read_and_written(declared):
    text = declared("intersection").source.decode()
    table = f"{DELAY}\nmin_delay = -9\nmax_gap_below_1_s = 0.25"
    profile = parse(f"{text}\n[caused]\n{table}\n".encode())
    ends = (-50.0, 200.0)
    bounds = (
        Bound("delay", "at most", 6.0, ends),
        Bound("delay", "at least", -9.0, ends),
        Bound("gap_below_1_s", "at most", 0.25),
    )
    assert profile.caused == bounds and profile.effects == ("delay", "gap_below_1_s")
    assert profile.bounds == (*profile.competence.bounds, *bounds)
    assert declared("intersection", caused=bounds).caused == bounds
    assert "# Largest mean of metres" in declared("intersection", caused=bounds).source.decode()
    assert declared("intersection").source.decode() == text and "caused" not in text
    assert declared("crossing7", caused=bounds[:2]).caused == bounds[:2]


@pytest.mark.parametrize(
    ("world", "table", "field", "says"),
    [
        ("intersection", "max_delay =", "max_delay", "not TOML"),
        ("intersection", 'max_delay = "6 min"', "max_delay", "(m), got '6 min'"),
        ("intersection", "max_delay = [6]", "max_delay", "(m), got a list"),
        ("intersection", "max_delay = 6", "max_delay", "add caused.delay_range"),
        ("intersection", "delay_range = [-9, 9]", "delay_range", "add caused.max_delay"),
        ("intersection", "max_delay = 6\ndelay_range = [9, 2]", "delay_range", "smaller one first"),
        ("intersection", "max_delay = 9\ndelay_range = [2, 9]", "max_delay", "below 9, got 9"),
        ("intersection", f"{DELAY}\nmin_delay = 6", "min_delay", "below caused.max_delay (6)"),
        ("intersection", "max_braking = -1", "max_braking", "add caused.braking_range"),
        (
            "intersection",
            "max_gap_below_1_s = 25",
            "max_gap_below_1_s",
            "at most 1 (share of episodes)",
        ),
        ("intersection", "min_gap_below_1_s = -0.1", "min_gap_below_1_s", "at least 0"),
        ("intersection", "max_delays = 6", "max_delays", "choose one of max_delay"),
        ("crossing7", "max_braking = 1", "max_braking", "crossing7 measures only delay: leave"),
        ("intersection-continuous", DELAY, "max_delay", "measures no effects: leave out"),
        ("CartPole-v1", DELAY, "max_delay", "or name intersection, merge, roundabout"),
    ],
)
def test_a_bound_that_can_not_be_tested_is_refused(declared, world, table, field, says):
    text = f"{declared('crossing5' if world[0] == 'C' else world).source.decode()}\n[caused]\n"
    line = complaint(f"{text}{table}\n".replace('world = "crossing5"', f'world = "{world}"'))
    places = [row for row, words in enumerate(f"{text}{table}".split("\n"), 1) if field in words]
    assert line.startswith(f"profile.toml:{places[-1]}: "), (line, places)
    assert says in line


@pytest.mark.parametrize(
    ("option", "says"),
    [
        ("speed_limit = 3", "unknown option of intersection 'speed_limit'"),
        ("initial_vehicle_count = 1000000", "at most 200 in an audit"),
        ("initial_vehicle_count = 3000000000", "within plus or minus 2,147,483,647"),
        ("duration = 100000", "at most 200 in an audit"),
        ("observed_vehicles = 100000", "observed_vehicles must be at most 200"),
        ("simulation_frequency = 100000", "simulation_frequency must be at most 100"),
        ("simulation_frequency = 10.0", "a whole number"),
        ("canonical = 1", "true or false"),
        ("spawn_probability = nan", "within plus or minus"),
        ('"\\u001b" = 1', "is not the name of an option"),
    ],
)
def test_a_hostile_option_is_refused(declared, option, says):
    text = declared("intersection").source.decode()
    head = "[scenario.options]"
    line = complaint(text.replace(head, f"{head}\n{option}"))
    place = text.split("\n").index(head) + 1
    assert line.startswith((f"profile.toml:{place}: ", f"profile.toml:{place + 1}: "))
    assert says in line


@pytest.mark.parametrize(
    ("addition", "says"),
    [
        ("colour = 1", "unknown field 'colour'"),
        ("[extra]\na = 1", "unknown field 'extra'"),
        ("'\x7f' = 1", "not TOML"),
        ('"\\u0007" = 1', "unknown field"),
        ("angle = 2", "not TOML: Cannot overwrite a value"),
        ("a = " + "[" * 2_000, "too long for a field"),
        ("a = " + "[\n" * 20_000, "nested too deeply"),
        ("a = " + "9" * 5000, "too long for a field"),
        ('a = """x"""', "multi-line text"),
        ("a = '''x'''", "multi-line text"),
        (".".join("a" * 200) + " = 1", "unknown field 'a'"),
        (".".join("a" * 300) + " = 1", "too long for a field"),
    ],
)
def test_what_does_not_belong_is_refused(text, addition, says):
    line = complaint(f"{addition}\n{text}")
    assert line.startswith("profile.toml:") and says in line


def test_a_table_must_be_one(text):
    line = complaint("margin = 3\n" + text.replace("[margin]", "[reward]", 1).split("[reward]")[0])
    assert "margin must be a table" in line and line.startswith("profile.toml:1: ")


@pytest.mark.parametrize("content", [b"\xff\xfe", b"a = 1\nb = \xe9\n"])
def test_what_is_not_text_is_refused(content):
    assert "not UTF-8" in complaint(content)


def test_a_large_file_is_refused_unread(tmp_path, text):
    path = tmp_path / "large.toml"
    path.write_text(text + "#" * LARGEST_FILE)
    with pytest.raises(UserError, match="more than 65536 bytes"):
        load(path)


def test_a_file_that_is_none_is_refused(tmp_path):
    places = {tmp_path: "is a folder", tmp_path / "missing.toml": "no such file"}
    for path, fault in places.items():
        with pytest.raises(UserError, match=fault):
            load(path)


@given(st.binary(max_size=300))
def test_any_bytes_are_refused_politely(content):
    complaint(content)


@settings(max_examples=40)
@given(place=st.integers(0, 2000), junk=st.text(max_size=6))
def test_a_damaged_file_is_read_or_refused_politely(text, place, junk):
    damaged = text[:place] + junk + text[place + len(junk) :]
    try:
        parse(damaged.encode("utf-8", "surrogatepass"))
    except UserError as error:
        assert re.match(r"profile\.toml:\d+: [^\n]+$", str(error))


def test_lines_are_found_in_every_spelling():
    text = 'a = 1\n"b" = 2 # b\n\n[ t . "u" ]\n c=3\nd.e = 4\nf = { g = 5 }\nh = [\n 1,\n]\n'
    expected = {"a": 1, "b": 2, "t.u": 4, "t.u.c": 5, "t.u.d.e": 6, "t.u.f.g": 7, "t.u.h": 8}
    assert {path: line_of(text, path) for path in expected} == expected
    assert line_of(text, "t.u.missing") == 4
    assert line_of(text, "missing") == 1
