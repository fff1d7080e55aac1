import importlib.resources
import json
import re
import tomllib

import numpy as np
import pytest

from socialiq import results_folder
from socialiq.errors import UserError
from socialiq.storage import packaged_results
from socialiq_lab import claims


@pytest.fixture(scope="module")
def rows():
    return claims.ledger(packaged_results())


def test_places_are_filled_from_the_results(tmp_path):
    (tmp_path / "grid").mkdir()
    (tmp_path / "grid" / "summary.json").write_text(json.dumps({"a": {"0.7": [1.26, 2]}}))
    summaries = claims.Summaries(tmp_path)
    text = claims.resolve("angle {grid:a.0,7.0:.1f} of {grid:a.0,7.1}", summaries)
    assert text == "angle 1.3 of 2"
    with pytest.raises(UserError, match="points at grid:b"):
        claims.resolve("{grid:b}", summaries)


def test_every_claim_is_complete(rows):
    assert len({row["id"] for row in rows}) == len(rows)
    for row in rows:
        assert row["place"] and row["statement"] and row["thesis"], row["id"]
        if row["verdict"] == "untested":
            assert row["reason"], f"{row['id']}: untested needs its reason"
        else:
            assert row["ours"], f"{row['id']}: a verdict needs our value"
            assert row["command"], f"{row['id']}: our value needs its command"
        if row["verdict"] in ("partly", "not"):
            assert row["reason"], f"{row['id']}: a failed claim needs its reason"


def test_every_claim_that_fails_has_its_cause_and_no_other_claim(rows):
    for row in rows:
        assert bool(row["cause"]) == (row["verdict"] == "not"), row["id"]
        if row["cause"].startswith("Our experts are other drivers"):
            assert row["verdict_matched"] != "not", row["id"]


def test_numbers_of_experts_have_a_second_verdict_with_experts_like_the_thesis(rows):
    judged = {row["id"]: row for row in rows if row["matched"]}
    for name in ("tab-6.2-collision-iq-ego", "tab-a.1-alt-classical-g-self"):
        assert judged[name]["verdict_matched"] in ("reproduced", "partly", "not"), name
    tables = [row for row in rows if row["id"].startswith(("tab-6.", "tab-a."))]
    assert len(tables) > 50
    assert all(row["matched"] for row in tables)


@pytest.mark.parametrize(
    ("ours", "expected"), [(-1.17, "reproduced"), (-1.3, "partly"), (-2.0, "not")]
)
def test_a_number_without_a_spread_is_judged_by_that_of_our_trios(tmp_path, ours, expected):
    cell = {"ours": ours, "over_trios": 0.2}
    summary = {"table_a_2": {"egoistic_prosocial": {"g_global": cell}}}
    (tmp_path / "expert-strength").mkdir()
    (tmp_path / "expert-strength" / "summary.json").write_text(json.dumps(summary))
    trios = {"config": {"trios": [50, 51, 52, 53]}}
    (tmp_path / "expert-strength" / "config.json").write_text(json.dumps(trios))
    claim = {"id": "d", "value": -1.17, "tolerance": 0.005, "thesis": "-1.17", "statement": ""}
    claim["our_value"] = "{intersection:table_a_2.egoistic_prosocial.g_global.ours}"
    judged = claims.matched(claim, claims.Summaries(tmp_path))
    assert judged["verdict_matched"] == expected
    assert judged["matched"] == f"{ours:.2f} +- 0.20 over 4 trios of experts"


def test_claims_about_social_impact_have_the_second_measure(rows):
    judged = [row for row in rows if row["caused"] or row["verdict_caused"]]
    assert len(judged) >= 10
    for row in judged:
        assert row["caused"], row["id"]
        assert row["verdict_caused"] in ("reproduced", "partly", "not"), row["id"]
    by_id = {row["id"]: row["verdict_caused"] for row in rows}
    caused = claims.Summaries(packaged_results())
    delays = [
        caused.at("caused-effects", f"expert_{mode}.delay")
        for mode in ("egoistic", "prosocial", "altruistic")
    ]
    falls = delays[0] > delays[1] > delays[2]
    assert by_id["a.2-ego-centric-monotone"] == ("reproduced" if falls else "not")
    zone = caused.at("influence-zone", "zones.intersection")
    wide = min(zone["recall_hand"], zone["precision_hand"]) > 0.5
    assert by_id["5.1.3-influence-zone"] == ("reproduced" if wide else "not")


def test_verdicts_on_chapters_8_and_9_follow_from_the_results(rows):
    verdicts = {row["id"]: row["verdict"] for row in rows}
    at = claims.Summaries(packaged_results()).at

    def column(study, table, name, **conditions):
        rows = results_folder.load(packaged_results() / study).tables[table]
        return [row[name] for row in results_folder.where(rows, conditions)]

    modes = ("egoistic", "prosocial", "altruistic")
    place = "table_6_2.calibrated_online_greedy"
    falls = all(
        np.all(np.diff([at("intersection", f"{place}.{mode}.{rate}.ours") for mode in modes]) < 0)
        for rate in ("collision", "arrival")
    )
    assert (verdicts["9.3-alpha-dictates-rates"] == "reproduced") == falls
    cells = {"angle": 90.0, "class_angle": [0.0, 90.0]}
    cars, people = column("crosswalk-intersection", "prices", "pedestrian_delay_low", **cells)
    (egoist,) = column(
        "crosswalk-intersection", "prices", "pedestrian_delay_high", angle=0.0, class_angle=0.0
    )
    obstructs = cars > egoist > people
    assert (verdicts["9.3-withdrawn-obstructs-pedestrians"] == "reproduced") == obstructs
    fleets = {"dial": "Eq 4.2", "spawn_probability": 0.6}
    arrivals = column("population", "fleets", "arrival", **fleets)
    egoists_are_worst = arrivals[0] == min(arrivals)
    helped = max(arrivals) > arrivals[0]
    assert verdicts["9.4-egoists-suboptimal"] == ("reproduced" if egoists_are_worst else "partly")
    assert helped
    invaded = {"resident": 60.0, "invader": 0.0}
    gains = {
        dial: column("population", "invasions", "gain_low", dial=dial, **invaded)[0] > 0
        for dial in ("Eq 4.2", "effects", "self-play 501")
    }
    assert verdicts["9.4-prosocial-exploited"] == (
        "reproduced" if all(gains.values()) else "partly"
    )
    assert any(gains.values())
    resisted = at("misuse", "quiet.worst.extra_low") <= 0
    assert (verdicts["9.5-no-mechanism"] == "reproduced") == (not resisted)
    gaps = [at("caused-effects", f"expert_{mode}.gap_below_1_s") for mode in modes]
    assert (verdicts["9.5-externalised"] == "reproduced") == (gaps == sorted(gaps, reverse=True))


def test_numeric_verdicts_follow_from_the_numbers(rows):
    compared = 0
    for row in rows:
        if row["from_numbers"] is None:
            continue
        compared += 1
        verdict = row["from_numbers"]
        if verdict == "not" and row["verdict"] == "partly" and row["reason"]:
            continue  # of a claim of one number a part may hold all the same, which is then said
        expected = "reproduced" if row["verdict"] == "adopted" else row["verdict"]
        assert verdict == expected, (row["id"], row["our_value"], row["tolerance"])
    assert compared >= 30


def test_a_setting_that_our_code_takes_from_the_thesis_is_adopted_not_reproduced(rows):
    text = importlib.resources.files("socialiq_lab").joinpath("claims.toml").read_text()
    setting = re.compile(
        r"weights|options|settings|presets|horizon$|actions$|features$|slots$|spawn_probability$"
    )
    by_id = {row["id"]: row for row in rows}
    for claim in tomllib.loads(text)["claim"]:
        paths = [path for _, path, _ in claims._PLACE.findall(claim.get("ours", ""))]
        is_setting = bool(paths) and all(setting.search(path) for path in paths)
        if is_setting and "command" not in claim:
            assert by_id[claim["id"]]["verdict"] != "reproduced", claim["id"]
    assert claims.count(rows)["adopted"] > 0


def test_what_holds_under_a_choice_of_ours_names_it(rows):
    words = r"greed|softly|\brunning\b|instantaneous|to_go|V\(s'\)|calibrated|\bzone\b"
    for row in rows:
        if row["verdict"] == "reproduced" and row["place"][0] in "4567ABD":
            named = re.search(words, row["ours"])
            assert not named or row["conditions"], (row["id"], named)


def test_a_tolerance_that_cannot_fail_is_refused():
    summaries = claims.Summaries(packaged_results())
    claim = _of_table_a_1()
    claim["tolerance"] = claim.pop("spread")
    with pytest.raises(UserError, match=r"tolerance 3.45 for a number printed to 0.01"):
        claims.compared(claim, summaries)
    claim["spread"] = 3.45
    with pytest.raises(UserError, match="a spread of episodes is no tolerance"):
        claims.compared(claim, summaries)


def test_the_spread_of_episodes_reproduces_no_other_mean(rows):
    of_table = [row for row in rows if row["id"].startswith("tab-a.1-")]
    assert len(of_table) == 12
    for row in of_table:
        # two standard errors of 3,000 episodes, not the 1 to 7 that single ones spread by
        assert row["tolerance"] < 0.15, row["id"]


def _of_table_a_1():
    text = importlib.resources.files("socialiq_lab").joinpath("claims.toml").read_text()
    name = "tab-a.1-ego-classical-g-self"
    return next(claim for claim in tomllib.loads(text)["claim"] if claim["id"] == name)


def test_every_tested_claim_of_one_number_states_our_number(rows):
    for row in rows:
        if row["value"] is not None and row["verdict"] != "untested":
            assert row["our_value"] is not None, row["id"]


def test_our_numbers_are_never_typed():
    text = importlib.resources.files("socialiq_lab").joinpath("claims.toml").read_text()
    for claim in tomllib.loads(text)["claim"]:
        callbacks = claims._PLACE.sub("", claim.get("ours", "") + " " + claim.get("caused", ""))
        assert "." not in "".join(
            callbacks[i - 1 : i + 2]
            for i in range(1, len(callbacks) - 1)
            if callbacks[i] == "." and callbacks[i - 1].isdigit() and callbacks[i + 1].isdigit()
        ), claim["id"]


def test_commands_name_things_that_exist(rows):
    from pathlib import Path

    root = Path(__file__).parents[3]
    for row in rows:
        words = row["command"].split()
        for word in words:
            if word.startswith("tests/"):
                path, *names = word.split("::")
                assert (root / path).exists(), row["id"]
                for name in names:
                    assert f"def {name}(" in (root / path).read_text(), (row["id"], name)
