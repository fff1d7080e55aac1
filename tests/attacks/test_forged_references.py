"""Attack: what a report says about its references is changed, and all that follows is made again.

The policy's episodes are untouched and every number follows from the table; a fail became a pass
that plain `audit verify` confirmed and `audit sign` signed.
"""

import csv
import io
import json
import re

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from tests.attacks.conftest import recomputed

from socialiq.cli.main import main


def rewritten(folder, change):
    """Return a table of episodes with changed columns: a dictionary of lists by their heads."""
    rows = list(csv.reader(io.StringIO((folder / "episodes.csv").read_text())))
    columns = {head: list(column) for head, *column in zip(*rows, strict=True)}
    change(columns)
    text = io.StringIO()
    table = zip(*([head, *column] for head, column in columns.items()), strict=True)
    csv.writer(text, lineterminator="\n").writerows(table)
    return text.getvalue().encode()


def weakest(report):
    return min(report["references"], key=lambda row: row["value"])


def optimum_expects_less(report, _):
    for row in report["references"]:
        row["expected"] = dict.fromkeys(("env", "social"), -99.0)
    weakest(report)["expected"] = {"env": 0.0, "social": 0.0}


def strong_ones_are_dropped(report, columns):
    report["references"] = [weakest(report)]
    remaining = ("episode", "seed", "density", "policy", report["references"][0]["name"])
    for head in list(columns):
        if head.partition(".")[0] not in remaining and "trivial_" not in head:
            del columns[head]


def strong_ones_pass_as_the_policy(report, _):
    report["left_out"] = [row for row in report["references"] if row != weakest(report)]
    report["references"] = [weakest(report)]
    for row in report["left_out"]:
        row["record"] = report["policy"]["record"]


def strong_ones_are_weakened(report, columns):
    for row in report["references"]:
        for side, column in (("r_env", "env"), ("r_social", "social")):
            mine, own = columns[f"policy.{side}"], f"{row['name']}.{side}"
            columns[own] = [repr(float(reward) - 0.5) for reward in mine]
            row["expected"][column] -= 9.0


def an_invented_one_is_the_best(report, columns):
    invented = {"name": "invented", "expected": {"env": 99.0, "social": 99.0}}
    report["references"].append({**report["references"][0], **invented})
    heads = list(columns)
    at = next(place for place, head in enumerate(heads) if head.startswith("trivial_"))
    copied = {
        head.replace("policy", "invented"): columns[head] for head in heads if "policy." in head
    }
    kept = dict(columns)
    columns.clear()
    columns |= {head: kept[head] for head in heads[:at]} | copied
    columns |= {head: kept[head] for head in heads[at:]}


def an_invented_one_is_the_users(report, columns):
    an_invented_one_is_the_best(report, columns)
    report["reference_files"] = ["invented.safetensors"]


@pytest.fixture(scope="module")
def failed(place, tmp_path_factory):
    """The folder of an audit that fails by its regret alone."""
    folder = tmp_path_factory.mktemp("open floor")
    text = (place / "profile.toml").read_text().replace("max_timeout = 0.9", "max_timeout = 1.0")
    (folder / "profile.toml").write_text(text.replace("min_arrival = 0.1", "min_arrival = 0.0"))
    words = ["audit", str(place / "altruist.safetensors"), "--episodes", "200", "--seed", "7"]
    words += ["--profile", str(folder / "profile.toml"), "--out", str(folder / "out")]
    assert main(words) == 1
    return folder / "out"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (optimum_expects_less, "exact numbers of optimum_00"),
        (strong_ones_are_dropped, "optimum_00 is missing"),
        (strong_ones_pass_as_the_policy, "the record of optimum_00"),
        (strong_ones_are_weakened, r"optimum_00 drives (\d+) of \1 episodes otherwise"),
        (an_invented_one_is_the_best, "no one named the reference invented"),
        (an_invented_one_is_the_users, "no one named the reference invented"),
    ],
)
def test_a_fail_becomes_no_pass(failed, reseal, tmp_path, capsys, change, says):
    report = json.loads((failed / "report.json").read_text())
    table = rewritten(failed, lambda columns: change(report, columns))
    made_up = reseal(
        failed, tmp_path / "made up", lambda told: told.update(report), episodes_csv=table
    )
    fresh = recomputed(made_up)
    copy = reseal(made_up, tmp_path / "forged", lambda told: told.update(fresh))
    assert fresh["tests"]["regret"]["decision"] == "pass"
    capsys.readouterr()
    assert main(["audit", "verify", str(copy)]) == 1
    assert re.search(says, capsys.readouterr().err)
    if change is not optimum_expects_less:
        return
    key = tmp_path / "key.pem"
    key.write_bytes(
        Ed25519PrivateKey.generate().private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    )
    assert main(["audit", "sign", str(copy), "--key", str(key)]) == 1
    assert not (copy / "statement.dsse.json").exists()


def test_effects_of_a_reference_are_driven_again(passed, reseal, tmp_path, capsys):
    """A reference that seems to cost others much makes the bound look strict."""

    def costs_others(columns):
        columns["optimum_01.delay"] = ["9.0"] * len(columns["seed"])

    table = rewritten(passed, costs_others)
    made_up = reseal(passed, tmp_path / "made up", lambda _: None, episodes_csv=table)
    fresh = recomputed(made_up)
    copy = reseal(made_up, tmp_path / "forged", lambda told: told.update(fresh))
    capsys.readouterr()
    assert main(["audit", "verify", str(copy)]) == 1
    assert re.search(r"optimum_01 drives (\d+) of \1 episodes otherwise", capsys.readouterr().err)


def test_one_line_says_what_is_left_to_believe(passed, capsys):
    capsys.readouterr()
    assert main(["audit", "verify", str(passed), "--all-episodes"]) == 0
    (line,) = [one for one in capsys.readouterr().out.splitlines() if "left to believe" in one]
    assert "the episodes and answers of the policy (--rerun)" in line
    assert "of the references" not in line
