"""Attack: text of an environment's owner becomes markup in a page of the report."""

from socialiq.audit.report.documents import Claim, mermaid
from socialiq.audit.report.views import code

HOSTILE = '``` <script>alert(1)</script> ```` "] click G0 href "javascript:alert(1)"'


def test_options_stay_code_after_a_list():
    """Four spaces after a list item are a paragraph of that item, not code."""
    fence, *lines, last = code(HOSTILE).splitlines()
    assert set(fence) == {"`"} and last == fence and lines == [HOSTILE]
    assert fence not in HOSTILE


def test_a_worlds_name_stays_in_its_node():
    _, node = mermaid([Claim("G1", f"in {HOSTILE}", "supported", "")]).splitlines()
    label = node.removeprefix('  G1["').removesuffix('"]').replace("<br>", "")
    assert not set(label) & set('"<>[]`')
