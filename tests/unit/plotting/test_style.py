"""Titles, labels and legends of figures."""

from socialiq.plotting.style import figure, finish, head


def test_a_panel_has_its_title_labels_and_a_legend_only_if_asked():
    first, second = figure(6.0, 2.0).subplots(1, 2)
    for axes, legend in ((first, 8), (second, None)):
        axes.plot([0, 1], [0, 1], label="both")
        finish(axes, "totals", legend, xlabel="updates", ylim=(0, 2))
        assert (axes.get_title(), axes.get_xlabel(), axes.get_ylim()) == (
            "totals",
            "updates",
            (0, 2),
        )
    assert [text.get_text() for text in first.get_legend().get_texts()] == ["both"]
    assert second.get_legend() is None


def test_a_figure_has_the_legend_of_one_panel():
    drawn = figure(6.0, 2.0)
    first, second = drawn.subplots(1, 2)
    first.plot([0, 1], [0, 1], label="both")
    second.plot([0, 1], [1, 0], label="only here")
    head(drawn, "title", first)
    assert drawn.get_suptitle() == "title"
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == ["both"]
