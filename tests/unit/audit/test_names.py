from socialiq.audit.report.words import names_of, plain_name
from socialiq.audit.request import GAPS
from socialiq.worlds.intersection.world import Intersection

MODES = ("egoistic", "prosocial", "altruistic")


def test_every_driver_of_the_package_has_a_name_in_words():
    experts = [f"{kind}_{mode}" for kind in ("set", "expert") for mode in MODES]
    for name in (*Intersection.references, *GAPS, *experts):
        found = plain_name(name)
        assert found != name and "_" not in found
    assert plain_name("set_prosocial").startswith("trained for 45°")


def test_optima_are_named_by_their_angles():
    assert plain_name("optimum_03", (13.0, 56.31)) == "best possible for 13° to 56.3°"
    assert plain_name("optimum_20", (300.0, 370.0)) == "best possible for −60° to 10°"


def test_trivial_drivers():
    assert plain_name("trivial_random") == "chooses at random"
    assert plain_name("trivial_STOP") == "always chooses “STOP”"
    assert plain_name("trivial_action_0") == "always chooses “action 0”"


def reference(name, record=None):
    return {"name": name, "angles": [], "record": record}


def test_a_driver_of_the_user_keeps_its_name():
    file = {"kind": "policy", "source": "runs/go.safetensors"}
    report = {
        "references": [reference("go", file), reference("wait"), reference("gap_2s", RULE)],
        "trivial": [{"name": "trivial_random"}],
        "left_out": [reference("mine", file), reference("idm")],
    }
    assert names_of(report) == {
        "go": "go",
        "wait": "always waits",
        "gap_2s": "goes at gaps of 2 s",
        "trivial_random": "chooses at random",
        "mine": "mine",
        "idm": "Intelligent Driver Model: follows the car in front and gives way",
    }


RULE = {"kind": "rule", "source": "gap_2s"}
