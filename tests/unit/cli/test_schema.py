"""Policies of the observation along the route: one file for every road, refused where rows are."""

import dataclasses
import json

import pytest

from socialiq.cli.main import main
from socialiq.nn.q_policy import QPolicy
from socialiq.policies.interface import Interface

ROUTE = "intersection,observation=route"


@pytest.fixture(name="demonstrations", scope="module")
def demonstrations_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "demo.safetensors"
    words = ["--driver", "gap_3s", "--episodes", "6", "--out", str(path)]
    assert main(["collect", ROUTE, *words]) == 0
    return path


@pytest.fixture(name="policy", scope="module")
def policy_file(demonstrations, tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "run"
    words = ["--updates", "5", "--hidden", "8", "--set", "view=set", "--out", str(out)]
    assert main(["train", "iq-learn", str(demonstrations), "--angle", "45", *words]) == 0
    return out / "policy_angle45.safetensors"


def test_a_file_names_the_schema_of_its_observations(policy):
    assert QPolicy.load(policy).provenance["observation"] == "route-1"


@pytest.mark.parametrize(
    "world", [ROUTE, "merge,observation=route", "road,seed=3,observation=route,unseen=0.5"]
)
def test_one_policy_drives_on_every_road(policy, world, capsys):
    capsys.readouterr()
    words = ["--world", world, "--episodes", "4", "--json"]
    assert main(["evaluate", str(policy), *words]) == 0
    assert json.loads(capsys.readouterr().out)


def test_a_world_shows_it_the_route_unless_the_text_asks_for_rows(policy, capsys):
    capsys.readouterr()
    outcomes = []
    for world in ("merge", "merge,observation=route"):
        assert main(["evaluate", str(policy), "--world", world, "--episodes", "2", "--json"]) == 0
        outcomes.append(json.loads(capsys.readouterr().out)["r_env"])
    assert outcomes[0] == outcomes[1]
    world = "merge,observation=rows"
    assert main(["evaluate", str(policy), "--world", world, "--episodes", "2"]) != 0
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert "route-1" in line and "add observation=route to the world" in line


@pytest.mark.parametrize("named", ["route-2", "lidar-1", "", 7, ["route-1"]])
def test_a_schema_that_no_world_shows_is_refused_in_one_line(policy, named, tmp_path, capsys):
    network = QPolicy.load(policy)
    unknown = tmp_path / "policy.safetensors"
    provenance = {**network.provenance, "observation": named}
    dataclasses.replace(network, provenance=provenance).save(unknown)
    profile = tmp_path / "profile.toml"
    declared = ["--world", "intersection", "--angle", "45", "--owner", "A", "--out", str(profile)]
    assert main(["profile", "new", *declared]) == 0
    capsys.readouterr()
    audited = ["--profile", str(profile), "--out", str(tmp_path / "audit"), "--seed", "1"]
    for words in (["evaluate", "--world", "merge", "--episodes", "2"], ["audit", *audited]):
        assert main([words[0], str(unknown), *words[1:]]) == 2
        line = capsys.readouterr().err.strip()
        assert f"schema {named}, which this version does not know" in line and "\n" not in line
    assert not (tmp_path / "audit").exists()


def test_a_policy_of_rows_is_refused_along_the_route(capsys):
    assert main(["evaluate", "prosocial", "--world", ROUTE, "--episodes", "2"]) != 0
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert "rows-1" in line and "leave observation=route out of the world" in line


def test_a_gridworld_has_no_route(capsys):
    assert main(["evaluate", "x", "--world", "crossing7,observation=route"]) != 0
    assert "observe the state of its cells" in capsys.readouterr().err


def test_an_unknown_schema_is_answered_with_those_that_there_are(capsys):
    assert main(["evaluate", "idm", "--world", "merge,observation=lidar"]) != 0
    assert "rows, route" in capsys.readouterr().err


def test_records_name_a_schema_other_than_rows():
    route = Interface(674, 5, schema="route-1")
    assert Interface.of_json(route.as_json()) == route
    assert "schema" not in Interface(70, 3, schema="rows-1").as_json()


def test_an_audit_drives_along_the_route(policy, tmp_path):
    profile = tmp_path / "profile.toml"
    assert main(["profile", "new", "--world", ROUTE, "--angle", "45", "--out", str(profile)]) == 0
    words = ["--profile", str(profile), "--episodes", "30", "--out", str(tmp_path / "report")]
    assert main(["audit", str(policy), *words]) in (0, 1)
    report = json.loads((tmp_path / "report" / "report.json").read_text())
    assert report["policy"]["record"]["schema"] == "route-1"


@pytest.mark.parametrize("world", ["merge", "intersection,people=0.1"])
def test_a_rule_reads_rows_whatever_policies_observe(world, capsys):
    """With 16 rows and those behind, a rule drives the same episodes as along the route."""
    means = []
    for words in ("observation=route", "observed_vehicles=16,see_behind=true"):
        capsys.readouterr()
        arguments = ["evaluate", "idm", "--world", f"{world},{words}", "--episodes", "20", "--json"]
        assert main(arguments) == 0
        means.append(json.loads(capsys.readouterr().out)["r_env"])
    assert means[0] == pytest.approx(means[1], abs=1e-6)
