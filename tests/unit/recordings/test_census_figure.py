from socialiq.plotting.style import png
from socialiq_recordings.census_figure import census


def driver(ending, speed, angle, low=None, high=None):
    return {
        "ending": ending,
        "speed": speed,
        "r_env": 0.5,
        "r_social": 0.1,
        "decisions": 4,
        "angle": angle,
        "low": low,
        "high": high,
    }


def test_everybody_is_drawn_once():
    drivers = [
        driver("truncated", 0.0, 90.0, 80.0, 95.0),
        driver("truncated", 5.0, 10.0),
        driver("truncated", 6.0, None),
        driver("arrival", 7.0, 3.0),
    ]
    interval = {"estimate": 11.0, "low": 5.0, "high": 20.0}
    population = {
        "drivers": 4,
        "recordings": 1,
        "r_env": 0.5,
        "r_social": 0.1,
        "over_drivers": interval,
        "over_chains": None,
        "vehicles": 3,
        "chains": 1,
        "standing": 1,
        "of_the_moving": interval | {"estimate": 7.0},
        "confidence": 0.95,
    }
    posterior = [
        {"low": 0.0, "high": 15.0, "share": 0.75, "share_moving": 1.0},
        {"low": 15.0, "high": 30.0, "share": 0.25, "share_moving": 0.0},
    ]
    drawn = census(drivers, population, posterior)
    points, angles, posteriors = drawn.axes
    labels = [text.get_text() for text in points.get_legend().get_texts()]
    assert "left the view (2)" in labels and "arrived (1)" in labels
    assert "left the view, stood all the time (1)" in labels
    assert "mean: 11° (95 % over drivers: 5° to 20°)" in labels
    assert "without those who stood: 7°" in labels
    shown = [text.get_text() for text in angles.get_legend().get_texts()]
    assert shown == ["no interval (2)", "with interval (1)"]
    heights = [stairs.get_data().values.tolist() for stairs in posteriors.patches]
    assert heights == [[75.0, 25.0], [100.0, 0.0]]
    assert png({"census": drawn})["census"].startswith(b"\x89PNG")


def test_without_a_posterior_or_a_moving_vehicle():
    interval = {"estimate": 95.0, "low": 90.0, "high": 99.0}
    population = {
        "drivers": 1,
        "recordings": 1,
        "r_env": -0.1,
        "r_social": 1.0,
        "over_drivers": interval,
        "over_chains": None,
        "vehicles": 3,
        "chains": 1,
        "standing": 1,
        "of_the_moving": None,
        "confidence": 0.95,
    }
    standing = [driver("truncated", 0.0, 95.0)]
    assert len(census(standing, population, []).axes[2].patches) == 0
    still = [{"low": 90.0, "high": 105.0, "share": 1.0, "share_moving": float("nan")}]
    assert len(census(standing, population, still).axes[2].patches) == 1
