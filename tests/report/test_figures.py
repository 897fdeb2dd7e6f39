"""Figures hold the data they are given, and arrows point the way messages go."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch

from lockstep.model.agents.agent import Agent
from lockstep.model.graphs.graph import Graph
from lockstep.model.simulation import Trajectory
from lockstep.report.export import inline_svg, pdf, png
from lockstep.report.figures import (
    disagreement_figure,
    effort_figure,
    graph_figure,
    states_figure,
    thinned,
)
from lockstep.report.style import DARK, LIGHT, SERIES


def run(K=300, N=3, n=2, x=None) -> Trajectory:
    t = np.linspace(0.0, 3.0, K)
    phases = np.arange(N * n).reshape(1, N, n)
    x = np.exp(-t)[:, None, None] * np.cos(5 * t[:, None, None] + phases) if x is None else x
    u = x[:, :, :1]
    names = tuple(f"s{k}" for k in range(n))
    return Trajectory(
        t, x, np.zeros((K, N, 1)), u, x[:, :, :1], 0 * x, names, ("u",), ("y",), "a", u_hold="held"
    )


def test_states_are_drawn_one_panel_per_state_and_one_line_per_agent():
    trajectory = run()
    panels = states_figure(trajectory, units={"s0": "rad"}).axes
    assert [panel.get_title(loc="left") for panel in panels] == ["s0 in rad", "s1"]
    for k, panel in enumerate(panels):
        for i, drawn in enumerate(panel.lines):
            np.testing.assert_array_equal(drawn.get_ydata(), trajectory.x[:, i, k])


def test_a_signal_that_has_no_unit_is_named_alone():
    """A pure number's unit in the file, "1", is none to be read."""
    agent = Agent.from_expressions(
        "a",
        states=["s0"],
        inputs=["u"],
        outputs={"y": "s0"},
        dynamics={"s0": "u"},
        units={"s0": "1", "u": "N"},
    )
    assert agent.shown_units == {"u": "N"}
    (one,) = states_figure(run(n=1), units=agent.shown_units).axes
    assert one.get_title(loc="left") == "s0"
    (large,) = states_figure(run(n=1, x=1e6 * run(n=1).x), units=agent.shown_units).axes
    assert large.get_title(loc="left").startswith("s0 in 10")


def test_chosen_states_only():
    assert len(states_figure(run(), ["s1"]).axes) == 1


def test_agents_differ_by_dashes_as_well():
    panel = states_figure(run(N=8)).axes[0]
    assert len({(d.get_color(), str(d._dash_pattern)) for d in panel.lines}) == 8
    assert len({str(d._dash_pattern) for d in panel.lines}) == 8


def test_many_agents_have_no_legend():
    assert not states_figure(run(N=9)).legends
    assert states_figure(run(N=8)).legends


@pytest.mark.parametrize("N", [1, 3, 4, 8])
@pytest.mark.parametrize("name", ["a", "flexible_joint_arm", "a_name_that_is_quite_long_" * 2])
def test_a_legend_lies_within_its_figure_and_below_the_panels(N, name):
    figure = states_figure(replace(run(N=N), agent=name))
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    width, height = figure.get_size_inches() * figure.dpi
    assert 0 <= box.x0 <= box.x1 <= width
    label = figure.axes[-1].xaxis.label.get_window_extent()
    assert 0 <= box.y0 <= box.y1 <= label.y0
    if name == "a":
        short = states_figure(run(N=N))
        np.testing.assert_array_equal(figure.get_size_inches(), short.get_size_inches())
    heights = {round(panel.get_position().height * height, 6) for panel in figure.axes}
    assert heights == {round(1.15 * figure.dpi, 6)}


def test_held_inputs_are_steps():
    assert effort_figure(run()).axes[0].lines[0].get_drawstyle() == "steps-post"


def test_disagreement_is_the_distance_from_the_mean_on_a_logarithmic_axis():
    trajectory = run()
    figure = disagreement_figure(trajectory, {"s0": "Pa"})
    axes, x = figure.axes[0], trajectory.x
    expected = np.sqrt(((x - x.mean(axis=1)[:, None]) ** 2).sum(axis=1))
    for drawn, state in zip(
        axes.lines, expected.T, strict=True
    ):  # a line for each state: nothing adds Pa to m
        np.testing.assert_allclose(drawn.get_ydata(), state, rtol=1e-12)
    assert axes.get_yscale() == "log"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["s0 in Pa", "s1"]


@pytest.mark.parametrize(
    ("size", "title", "tick"), [(2e6, "s0 in 10⁶ Pa", "−1"), (3e-3, "s0 in 10⁻³ Pa", "−1")]
)
def test_ticks_never_need_more_than_their_room(size, title, tick):
    axes = states_figure(
        run(x=size * np.sin(np.arange(1800.0)).reshape(300, 3, 2)), ["s0"], {"s0": "Pa"}
    ).axes[0]
    assert axes.get_title(loc="left") == title
    assert axes.yaxis.get_major_formatter()(-(1e6 if size > 1 else 1e-3)) == tick


@pytest.mark.parametrize("draw", [states_figure, disagreement_figure])
@pytest.mark.parametrize(
    ("horizon", "label"),
    [(3e-5, "t in 10⁻⁶ s"), (0.004, "t in 10⁻³ s"), (20.0, "t in s"), (86_400.0, "t in 10³ s")],
)
def test_ticks_of_time_do_not_run_into_each_other(draw, horizon, label):
    short = run()
    figure = draw(replace(short, t=short.t * horizon / 3))
    figure.draw_without_rendering()
    axes = figure.axes[-1]
    assert axes.get_xlabel() == label
    boxes = [tick.get_window_extent() for tick in axes.get_xticklabels() if tick.get_text()]
    assert len(boxes) > 3
    assert all(one.x1 + 2 < other.x0 for one, other in itertools.pairwise(boxes))


def test_agreement_from_the_start_is_drawn_without_a_logarithm_of_zero():
    # warnings are errors here: log 0 would be one
    axes = disagreement_figure(run(x=np.ones((300, 3, 2)))).axes[0]
    assert axes.get_yscale() == "linear"


def test_arrows_run_from_source_to_listener():
    # 1 listens to 2, nobody else to anybody but 3 to 1
    figure = graph_figure(Graph.from_edges(3, [[1, 2], [3, 1]]))
    axes = figure.axes[0]
    places = {text.get_text(): np.array(text.get_position()) for text in axes.texts}
    arrows = {_ends(arrow, places) for arrow in axes.patches if isinstance(arrow, FancyArrowPatch)}
    assert arrows == {("2", "1"), ("1", "3")}


def _ends(arrow, places):
    start, end = (np.array(end) for end in arrow._posA_posB)
    return tuple(min(places, key=lambda name: np.hypot(*(places[name] - p))) for p in (start, end))


def test_weights_are_written_only_where_they_say_something():
    plain = graph_figure(Graph.from_edges(2, [[1, 2], [2, 1]]))
    weighted = graph_figure(Graph.from_edges(2, [[1, 2, 0.5], [2, 1]]))
    assert {text.get_text() for text in plain.axes[0].texts} == {"1", "2"}
    assert "0.5" in {text.get_text() for text in weighted.axes[0].texts}


def test_large_graphs_are_drawn_in_a_moment():
    assert graph_figure(Graph.topology("complete", 60)).axes[0].collections
    assert not graph_figure(Graph.topology("cycle", 60)).axes[0].texts


def test_thinning_keeps_ends_and_extremes():
    rng = np.random.default_rng(0)
    t, values = np.arange(50_000.0), rng.standard_normal(50_000)
    few_t, few = thinned(t, values)
    assert len(few_t) <= 1_200
    assert (np.diff(few_t) > 0).all()
    assert (few_t[0], few_t[-1], few.min(), few.max()) == (0, 49_999, values.min(), values.max())


def test_the_same_figure_gives_the_same_bytes_and_no_date():
    first, second = states_figure(run()), states_figure(run())
    assert inline_svg(first, "a", "words") == inline_svg(second, "a", "words")
    assert png(first, "a") == png(second, "a")
    assert pdf(first, "a") == pdf(second, "a")
    assert png(first, "a").startswith(b"\x89PNG")
    assert pdf(first, "a").startswith(b"%PDF")
    for written in (png(first, "a"), pdf(first, "a")):
        assert b"Date" not in written
        assert b"atplotlib" not in written


def test_svg_follows_the_page_and_keeps_to_itself():
    text = inline_svg(states_figure(run()), "mine", 'words with "quotes"')
    assert 'role="img"' in text
    assert 'aria-label="words with &quot;quotes&quot;"' in text
    assert f"var(--ink, {LIGHT['ink']})" in text
    assert f"var(--series-1, {LIGHT['series-1']})" in text
    assert "<style" not in text
    assert "<metadata" not in text
    ids = [part.split('"')[0] for part in text.split(' id="')[1:]]
    assert ids
    assert all(name.startswith("mine-") for name in ids)


def test_shades_can_be_read():
    """WCAG 2.2, 1.4.3: 4.5 to 1 for text; here for every shade that carries information, in both schemes."""
    for scheme in (LIGHT, DARK):
        for name in ("ink", "soft", *SERIES):
            assert contrast(scheme[name], scheme["paper"]) >= 4.5, (name, scheme[name])
    assert contrast(LIGHT["ink"], DARK["paper"]) < 4.5, "light ink on dark paper would not do"


def contrast(one: str, other: str) -> float:
    """(L1 + 0.05) / (L2 + 0.05) of the relative luminances in WCAG 2.2."""
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def luminance(shade: str) -> float:
    channels = [int(shade[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return float(np.dot((0.2126, 0.7152, 0.0722), linear))


def test_contrast_of_black_and_white():
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)


def test_powers_of_units_are_raised():
    assert states_figure(run(), units={"s0": "rad/s^2"}).axes[0].get_title(loc="left") == "s0 in rad/s²"
