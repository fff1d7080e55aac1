"""Figures that a STUDY.toml declares: what is drawn, named and written where."""

import pytest

from socialiq.plotting.figures import colors_of, draw
from socialiq.results_folder import Results
from socialiq_lab.declared import declared_study
from socialiq_lab.tables import pivoted

ROWS = [
    {"method": method, "place": place, "angle": angle, "seed": seed, "score": score + seed}
    for method, score in (("ours", 1.0), ("theirs", 2.0))
    for place in ("a", "b")
    for angle in (0.0, 90.0)
    for seed in (0, 1)
]


def drawn(**specification):
    results = Results("a-study", {}, {"rows": ROWS}, {}, {})
    picture = draw({"table": "rows", "x": "angle", "y": "score"} | specification, results)
    assert picture is not None
    return picture


def test_each_value_has_a_line_of_its_own_and_the_legend_names_it_once():
    (axes,) = drawn(lines="method", each="seed", where={"place": "a"}).axes
    assert len(axes.lines) == 4
    assert axes.get_legend_handles_labels()[1] == ["ours", "theirs"]
    assert axes.lines[0].get_color() == axes.lines[1].get_color() != axes.lines[2].get_color()


def test_panels_may_be_of_several_columns_joined():
    picture = drawn(join={"cell": ["place", "angle"]}, panels="cell", x="seed", columns=2)
    assert [axes.get_title() for axes in picture.axes] == ["a, 0", "a, 90", "b, 0", "b, 90"]


def test_a_layer_without_a_legend_is_not_listed_twice():
    layers = [{}, {"kind": "points", "legend": False}]
    (axes,) = drawn(lines="method", where={"place": "a"}, layers=layers).axes
    assert axes.get_legend_handles_labels()[1] == ["ours", "theirs"]
    assert len(axes.lines) == 4


@pytest.mark.parametrize("kind", ["points", "bars"])
def test_names_at_x_may_be_turned(kind):
    (axes,) = drawn(x="method", kind=kind, rotation=60, where={"place": "a", "seed": 0}).axes
    labels = axes.get_xticklabels()
    assert labels and {label.get_rotation() for label in labels} == {60.0}


def test_text_is_written_beside_points():
    (axes,) = drawn(kind="points", text="place", where={"method": "ours", "seed": 0}).axes
    assert [text.get_text() for text in axes.texts] == ["a", "a", "b", "b"]


def test_ends_of_an_interval_are_drawn_and_empty_cells_left_out():
    rows = [
        {"x": 0.0, "y": 1.0, "low": 0.5, "high": 2.0},
        {"x": 1.0, "y": "", "low": "", "high": ""},
    ]
    results = Results("a-study", {}, {"rows": rows}, {}, {})
    specification = {"table": "rows", "x": "x", "y": "y", "kind": "points"}
    picture = draw(specification | {"error": ["low", "high"]}, results)
    assert picture is not None
    (bar,) = picture.axes[0].collections
    assert bar.get_segments()[0][:, 1].tolist() == [0.5, 2.0]


def test_layers_whose_first_table_is_empty_are_drawn():
    (axes,) = drawn(layers=[{"table": "none"}, {"color": "red", "label": "ours"}]).axes
    assert axes.lines[0].get_color() == "red"


def test_modes_have_the_colours_of_the_thesis_and_many_numbers_a_scale():
    assert colors_of(["egoistic", "baseline"])["egoistic"] == "#c23b22"
    few, many = colors_of([0.0, 1.0]), colors_of([0.0, 1.0, 2.0, 3.0])
    assert few[0.0] == "#2166ac" and len(many[0.0]) == 4
    assert len(set(map(str, colors_of([str(n) for n in range(12)]).values()))) == 12


def test_rows_of_a_figure_may_be_computed_and_a_view_turned():
    class Module:
        @staticmethod
        def doubled(results):
            return [row | {"score": 2 * row["score"]} for row in results.tables["rows"]]

    content = {
        "config": {"angle": 0.0},
        "figure": [
            {"name": "twice", "rows": "doubled", "x": "seed", "y": "score", "lines": "method"}
            | {"where": {"angle": "$angle", "place": "a"}}
        ],
        "view": [
            {"table": "rows", "pivot": ["method", "angle", "score"], "title": "at {angle}"},
            {"table": "none"},
        ],
    }
    study = declared_study("a-study", content, Module)
    results = Results("a-study", {"angle": 0.0}, {"rows": ROWS}, {}, {})
    (axes,) = study.figures(results)["twice"].axes
    assert axes.lines[0].get_ydata().tolist() == [2.0, 4.0]  # type: ignore[union-attr]
    (view,) = study.view(results)
    assert view.title == "at 0.0"
    assert view.rows == [
        {"method": "ours", "0": 1.5, "90": 1.5},
        {"method": "theirs", "0": 2.5, "90": 2.5},
    ]


def test_a_pivot_has_a_row_for_each_value_and_leaves_out_what_is_not_there():
    rows = [
        {"a": 1, "b": "x", "c": 2.0},
        {"a": 1, "b": "x", "c": 4.0},
        {"a": 2, "b": "y", "c": 1.0},
    ]
    assert pivoted(rows, "a", "b", "c") == [{"a": 1, "x": 3.0}, {"a": 2, "y": 1.0}]
