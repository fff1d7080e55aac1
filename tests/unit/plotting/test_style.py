"""Titles, labels and legends of figures."""

from socialiq.plotting.style import PAGE, SMALLEST, figure, finish, head, png


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


def test_a_figure_has_a_legend_of_all_panels_and_room_for_it():
    drawn = figure(6.0, 2.0)
    first, second = drawn.subplots(1, 2)
    first.plot([0, 1], [0, 1], label="both")
    second.plot([0, 1], [1, 0], label="only here")
    head(drawn, "title", legend=True)
    assert drawn.get_suptitle() == "title"
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == ["both", "only here"]
    assert drawn.get_figheight() > 2.0


def test_text_of_a_wide_figure_is_large_enough_on_a_page():
    drawn = figure(2 * PAGE, 2.0)
    small = drawn.add_subplot().text(0.5, 0.5, "small", fontsize=6)
    png({"wide": drawn})
    assert small.get_fontsize() == 2 * SMALLEST
