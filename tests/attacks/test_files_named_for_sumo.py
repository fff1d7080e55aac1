"""Attack: a network or a demand names a file that SUMO writes or reads.

It worked: a demand with the parameter `device.ssm.file` overwrote any file of the auditor, by
`world sumo`, `evaluate` and `audit` of a declaration. `tests/extras/test_sumo.py` runs it in SUMO.
"""

import pytest

from socialiq.reading import sha256_of_file
from socialiq.worlds.sumo.allowed import DEMAND, NETWORK
from socialiq.worlds.sumo.network import NETS, read_network
from socialiq.worlds.sumo.traffic import Scene, SumoOptions

SSM = '<param key="has.ssm.device" value="true"/><param key="device.ssm.file" value="VICTIM"/>'
FLOW = '<flow id="a" type="spy" begin="0" end="60" period="2" from="WC" to="CE">{}</flow>'
DEMANDS = {
    "of a type": f'<vType id="spy" vClass="passenger">{SSM}</vType>{FLOW.format("")}',
    "of a flow": FLOW.format(SSM),
    "of a stop": FLOW.format(f'<stop edge="WC" duration="1">{SSM}</stop>'),
    "of a route": f'<route id="r" edges="WC CE">{SSM}</route>{FLOW.format("")}',
    "of a picture": f'<vType id="spy" imgFile="VICTIM"/>{FLOW.format("")}',
    "of emissions": f'<vType id="spy" emissionClass="PHEMlight/../VICTIM"/>{FLOW.format("")}',
}
NETWORKS = {
    "included": ("<location", '<include href="VICTIM"/><location'),
    "schema": ("<location", '<x xsi:schemaLocation="VICTIM"/><location'),
    "light": (
        "<junction ",
        '<tlLogic id="C" type="actuated" programID="0" offset="0">'
        '<param key="file" value="VICTIM"/>'
        '<phase duration="9" state="G"/></tlLogic><junction ',
    ),
    "edge": ("</lane>", '<param key="file" value="VICTIM"/></lane>'),
}


@pytest.mark.parametrize("kind", DEMANDS)
def test_sumo_gets_no_file_name_of_a_demand(kind, tmp_path):
    file = tmp_path / "mine.rou.xml"
    file.write_text(f"<routes>{DEMANDS[kind]}</routes>")
    scene = Scene(SumoOptions(demand=str(file)))
    text = scene.demand(3, with_ego=True)
    assert "VICTIM" not in text and "<param" not in text and 'from="WC"' in text
    assert scene.user_demand.left_out


@pytest.mark.parametrize("kind", NETWORKS)
def test_sumo_gets_no_file_name_of_a_network(kind, tmp_path):
    file = tmp_path / "mine.net.xml"
    changed = NETS["crossing"].read_text().replace("/>\n    </edge>", "></lane>\n    </edge>")
    file.write_text(changed.replace(*NETWORKS[kind], 1))
    network = read_network(str(file))
    assert "VICTIM" not in network.xml and "<param" not in network.xml
    assert network.left_out


def test_what_ships_reaches_sumo_whole():
    for name in NETS:
        assert not read_network(name).left_out


def test_no_listed_attribute_names_a_file():
    waiting = [NETWORK, *DEMAND.values()]
    for allowed in waiting:
        waiting.extend(allowed.children.values())
        assert not {"param", "include"} & set(allowed.children)
        names = [name.lower().replace("profile", "") for name in allowed.attributes]
        assert not [name for name in names if "file" in name or name in ("href", "output")]


def test_a_file_is_hashed_as_it_was_read(tmp_path):
    file = tmp_path / "mine.net.xml"
    file.write_text(NETS["crossing"].read_text())
    network = read_network(str(file))
    assert network.sha256 == sha256_of_file(file) == read_network("crossing").sha256
    file.write_text(file.read_text() + "\n")
    assert read_network(str(file)).sha256 == sha256_of_file(file) != network.sha256
