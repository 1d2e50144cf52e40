"""Charts as data: what is drawn, said and written of a panel, without measuring anything."""

import json
import math
import stat
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from course import charts
from course.measure.colours import KEYS, key_of
from course.measure.data import document, from_json, json_text, panels_of
from course.measure.figure import Panel, Series, draw, text, write, write_picture
from course.measure.stability import stability_map
from course.rigid_body.integrators import INTEGRATORS

pytestmark = pytest.mark.smoke


def _axes(*panels, **layout):
    figure = draw(panels, figure=Figure(layout="constrained"), **layout)
    figure.canvas.draw()
    return figure.axes


def _names(ax):
    return [" ".join(name.get_text().split()) for name in ax.texts]


def _line(ax, label):
    (result,) = [line for line in ax.lines if line.get_label() == label]
    return result


# --- colours --------------------------------------------------------------------------------------


def test_every_integrator_has_a_colour_and_a_marker_of_its_own():
    ours = [KEYS[name] for name in INTEGRATORS]
    theirs = [KEYS[f"MuJoCo {name}"] for name in ("Euler", "RK4", "implicitfast", "discrete")]
    for group in (ours, theirs):
        assert len({colour for colour, _ in group}) == len({m for _, m in group}) == len(group)
    # What MuJoCo calls Euler and RK4 are two of these methods; the others are none of them.
    assert theirs[:2] == [KEYS["semi_implicit_euler"], KEYS["rk4"]]
    assert not {*theirs[2:]} & {*ours}


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("rk4", "rk4"),
        ("compiled rk4", "rk4"),
        ("MuJoCo Euler", "MuJoCo Euler"),
        ("MuJoCo Euler, one run", "MuJoCo Euler"),
        ("MuJoCo Euler, eulerdamp off", "MuJoCo Euler, eulerdamp off"),
        ("MuJoCo RK4 (spring)", "MuJoCo RK4"),
        ("MuJoCo Euler (spring)", "MuJoCo Euler (spring)"),
        ("worked answer", ""),
    ],
)
def test_a_name_finds_its_key(name, key):
    assert key_of(name) == key


def test_a_method_looks_the_same_on_every_panel_and_others_take_what_is_left():
    x = [1.0, 2.0]
    one = Panel("", series=[Series("a", x, x, "explicit_euler"), Series("other", x, x)])
    two = Panel("", series=[Series("first", x, x), Series("b", x, x, "explicit_euler")])
    first, second = _axes(one, two)
    looks = {(line.get_color(), line.get_marker()) for line in (first.lines[0], second.lines[1])}
    assert looks == {KEYS["explicit_euler"]}
    colours = [line.get_color() for ax in (first, second) for line in ax.lines]
    assert len({*colours}) == 2 and colours[1] == colours[2]


# --- drawing --------------------------------------------------------------------------------------


def test_scale_ticks_limits_and_lines():
    panel = Panel(
        "title",
        "step",
        "error",
        [Series("s", [3.0, 24.0], [1.0, 2.0])],
        "log",
        lines=[("y", 1.5, "tolerance"), ("x", 6.0, "limit")],
        spans=[("x", 3.0, 4.0, "jammed")],
        ticks=(3, 6, 12, 24),
        ylim=(0.1, None),
    )
    (ax,) = _axes(panel, title="over all")
    assert (ax.get_xscale(), ax.get_yscale(), ax.get_ylim()[0]) == ("log", "log", 0.1)
    assert [t.get_text() for t in ax.get_xticklabels()] == ["3", "6", "12", "24"]
    assert _names(ax) == ["jammed", "tolerance", "limit", "● s"]
    panel.legend = False
    assert _names(_axes(panel)[0]) == []


def test_theory_is_a_line_beside_the_points_and_never_in_their_place():
    series = Series("s", [1.0, 2.0, 4.0], [1.1, 4.2, 15.0], "rk4", "", lambda x: x**2)
    (ax,) = _axes(Panel("", series=[series], scale="log", theory="x squared"))
    points, dense = ax.lines[0], next(line for line in ax.lines if len(line.get_xdata()) > 3)
    assert points.get_ydata().tolist() == [1.1, 4.2, 15.0] and points.get_linestyle() == "None"
    np.testing.assert_allclose(dense.get_ydata(), dense.get_xdata() ** 2)
    assert to_hex(dense.get_color()) != points.get_color()
    assert _names(ax) == ["✚ s", "━ x squared"]
    assert series.expected.tolist() == [1.0, 4.0, 16.0]
    with pytest.raises(ValueError, match="which 'plain' has not"):
        _ = Series("plain", [1.0], [1.0]).expected


def test_what_has_no_place_on_the_axes_is_still_there():
    series = Series("s", [1.0, 2.0, 3.0], [5.0, math.inf, math.nan], failed=2)
    (ax,) = _axes(Panel("", series=[series]))
    assert _line(ax, "s").get_xdata().tolist() == [1.0]
    (triangle,) = [line for line in ax.lines if line.get_marker() == "^"]
    assert triangle.get_xdata().tolist() == [2.0] and triangle.get_ydata()[0] < 1.0
    crosses = [line for line in ax.lines if line.get_marker() == "x"]
    assert len(crosses) == 2 and all(cross.get_ydata() == [1.0] for cross in crosses)
    # Crosses whose cost is known stand there.
    series = Series("s", [1.0, 2.0], [5.0, 6.0], failed=2, failed_at=[0.25, 0.5])
    (ax,) = _axes(Panel("", series=[series], scale="log"))
    (crosses,) = [line for line in ax.lines if line.get_marker() == "x"]
    assert [*crosses.get_xdata()] == [0.25, 0.5] and [*crosses.get_ydata()] == [1.0, 1.0]
    assert ax.get_xlim()[0] < 0.25
    # A series that is nowhere finite is named all the same.
    (ax,) = _axes(Panel("", series=[Series("endless", [1.0], [math.inf])]))
    assert _names(ax) == ["● endless"]


def test_bounds_are_a_band_or_bars_across():
    x, y = [1.0, 2.0], [3.0, 4.0]
    band = Series("band", x, y, low=[2.0, 3.0], high=[5.0, 6.0])
    bars = Series("bars", x, y, low=[0.5, 1.0], high=[1.5, 4.0], across=True)
    first, second = _axes(Panel("", series=[band]), Panel("", series=[bars]))
    (filled,) = first.collections
    assert filled.get_paths()[0].get_extents().bounds == (1.0, 2.0, 1.0, 4.0)
    (across,) = second.collections
    assert [segment[:, 0].tolist() for segment in across.get_segments()] == [[0.5, 1.5], [1.0, 4.0]]


def test_bars_have_names_and_words():
    series = [
        Series("ours", [2.0, 0.0], ["a", "b"], style="bar", tags=["2", "none"]),
        Series("theirs", [1.0], ["c"], style="bar"),
    ]
    first, second = _axes(Panel("", series=series), Panel("", series=series, ticks=()))
    assert [t.get_text() for t in first.get_yticklabels()] == ["a", "b", "c"]
    assert [bar.get_width() for bar in first.patches] == [2.0, 0.0, 1.0]
    assert _names(first) == ["2", "none"]
    assert [t.get_text() for t in first.get_legend().get_texts()] == ["ours", "theirs"]
    assert first.yaxis_inverted() and not second.get_tightbbox().width > first.get_tightbbox().width
    # Over the same names the second is thinner, so that both are seen.
    (ax,) = _axes(Panel("", series=[series[0], Series("b", [1.0], ["a"], style="bar")]))
    assert ax.patches[-1].get_height() < ax.patches[0].get_height()


def test_a_point_with_an_empty_tag_has_no_word():
    curve = Series("c", [1.0, 2.0, 3.0], [1.0, 2.0, 3.0], tags=["", "middle"])
    bars = Series("b", [1.0, 2.0], ["d", "e"], style="bar", tags=["", "2"])
    first, second = _axes(Panel("", series=[curve]), Panel("", series=[bars]))
    words = [[t.get_text() for t in ax.texts if "c" not in t.get_text()] for ax in (first, second)]
    assert words == [["middle"], ["2"]]
    with pytest.raises(ValueError, match=r"^len\(tags\) must be at most that of x, 1, got 2$"):
        Series("c", [1.0], [1.0], tags=["one", "two"])


def test_a_map_shows_its_boundary_with_theory_over_it():
    grid = stability_map(lambda x, y: x * y, np.linspace(0.1, 2.0, 20), np.linspace(0.6, 2.0, 15))
    theory = Series("theory", 1.0 / grid.y, grid.y, "theory on a map", "--")
    panels = [Panel(name, grid=grid, series=[theory]) for name in ("one", "two", "three")]
    axes = _axes(*panels, columns=2)
    assert len(axes) == 3 + 1  # one colour bar for all
    assert axes[2].get_window_extent().width > 1.8 * axes[0].get_window_extent().width
    assert [t.get_text() for t in axes[0].get_legend().get_texts()] == ["measured", "theory"]
    (result,) = document(panels[:1])["panels"]
    edge = [1.0 / y for y in result["grid"]["y"]]
    assert result["grid"]["boundary"] == pytest.approx(edge, abs=0.1)


# --- what is said and written ---------------------------------------------------------------------


def test_the_text_is_the_notes_in_order():
    panels = [
        Panel(
            "",
            series=[Series("", [1.0], [1.0], note="two"), Series("", [1.0], [1.0])],
            notes=["one"],
        ),
        Panel("words alone", notes=["three"]),
    ]
    assert text(panels) == "one\ntwo\nthree"
    assert len(_axes(*panels)) == 1
    assert len(document(panels)["panels"]) == 1


def test_the_data_are_plain_json_and_come_back():
    series = Series(
        "s",
        np.array([1.0, 2.0]),
        [math.inf, 1.0 / 3.0],
        "rk4",
        theory=lambda x: x,
        low=[0.0, 0.1],
        high=[math.nan, 1.0],
        failed=1,
    )
    content = json_text(document([Panel("t", "x", "y", [series])]))

    def refuse(word):
        raise AssertionError(word)

    json.loads(content, parse_constant=refuse)
    (panel,) = from_json(content)["panels"]
    (result,) = panel["series"]
    assert result["y"] == [math.inf, 0.333333] and result["theory"] == [1.0, 2.0]
    assert math.isnan(result["high"][0]) and result["failed"] == 1 and result["key"] == "rk4"
    assert '"x": [ 1.0, 2.0 ]' in content
    assert document([Panel("t", data={"own": 1})]) == {"own": 1}
    long = Series("s", np.arange(500.0), np.arange(500.0) ** 2)
    (result,) = document([Panel("t", series=[long])])["panels"][0]["series"]
    assert len(result["x"]) == 200 and result["x"][-1] == 499 and result["y"][-1] == 499**2
    assert max(np.diff(result["x"])) == 3
    (dots,) = document([Panel("t", series=[replace(long, style="")])])["panels"][0]["series"]
    assert dots["x"] == long.x.tolist()


def test_what_is_drawn_again_looks_the_same():
    grid = stability_map(lambda x, y: x * y, np.linspace(0.1, 2.0, 20), np.linspace(0.6, 2.0, 15))
    panels = [
        Panel("map", "x", "y", [Series("edge", [1.0], [1.0], "theory on a map", "--")], grid=grid),
        Panel(
            "curves",
            "x",
            "y",
            scale="log",
            lines=[("y", 1.5, "tolerance")],
            xlim=(1.0, None),
            series=[
                Series(
                    "a",
                    [1.0, 10.0],
                    [1.0, 100.0],
                    "rk4",
                    theory=lambda x: x**2,
                    tags=["one", "two"],
                    hollow=True,
                    extra=True,
                )
            ],
        ),
        Panel("bars", series=[Series("b", [1.0], ["name"], style="bar", tags=["1"])], ticks=[]),
    ]
    again = panels_of(from_json(json_text(document(panels))))
    within, values = grid.within(), np.clip(np.log10(grid.values), -0.5, 0.5)
    assert again[0].grid is not None and np.all(again[0].grid.within() == within)
    np.testing.assert_allclose(np.log10(again[0].grid.values), values, atol=0.005)
    theory = again[1].series[0].expected
    assert theory.tolist() == pytest.approx([1.0, 100.0], rel=1e-5)
    assert again[0].grid.label == grid.label
    assert again[1].series[0].theory is not None and again[1].series[0].theory(
        3.0
    ) == pytest.approx(9.0, rel=2e-3)
    for panel, result in zip(panels, again, strict=True):
        panel.grid = result.grid = None
        for series in [*panel.series, *result.series]:
            series.theory = None
        assert result == panel


def test_committed_data_are_plain_json():
    def refuse(word):
        raise AssertionError(word)

    files = sorted(charts.FOLDER.glob("*.json"))
    assert len(files) > 15
    for path in files:
        json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
        assert path.with_suffix(".txt").is_file()
        assert (charts.PICTURES / f"{path.stem}.png").is_file()


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    target = tmp_path / "new" / "a.txt"
    assert write(target, "first\n") == target
    assert stat.S_IMODE(target.stat().st_mode) == 0o644

    def full(path):
        path.write_text("half", encoding="utf-8")
        raise OSError("full")

    with pytest.raises(OSError, match="full"):
        write(target, full)
    assert target.read_text(encoding="utf-8") == "first\n"
    assert [path.name for path in target.parent.iterdir()] == ["a.txt"]


def test_a_picture_is_a_png(tmp_path):
    figure = draw([Panel("", series=[Series("", [1.0], [1.0])])], figure=Figure())
    path = write_picture(figure, tmp_path / "a.png")
    assert path.read_bytes().startswith(b"\x89PNG")


def test_series_are_found_by_label():
    panel = Panel("", series=[Series(name, [1.0], [1.0]) for name in ("rk4", "rk4 late", "euler")])
    assert panel["rk4"] is panel.series[0] and panel["eul"] is panel.series[2]
    for label in ("midpoint", "r"):
        with pytest.raises(ValueError, match="label must be"):
            panel[label]


def test_six_curves_are_shown_and_the_others_are_named():
    x = [1.0, 2.0]
    panel = Panel("", series=[Series(f"m{k}", x, x, extra=k == 1) for k in range(9)])
    panel.series.append(Series("theory", x, x, "theory"))
    expected = ["m0", "m2", "m3", "m4", "m5", "m6", "theory"]
    assert [series.label for series in panel.shown()] == expected
    assert panel.others == ["m1", "m7", "m8"]
    assert [s.label for s in panel.shown(["m1"])] == ["m0", "m1", *expected[1:]]
    assert text([panel]) == "measured, not drawn: m1; m7; m8"
    (few,) = _axes(panel)
    assert len(few.lines) == 7 and few.figure.get_supxlabel() == text([panel])
    (more,) = _axes(panel, also=panel.others)
    assert len(more.lines) == 10 and more.figure.get_supxlabel() == ""
    # A curve that another panel draws is not called "not drawn".
    other = Panel("", series=[Series("m1", x, x)])
    assert text([panel, other]).splitlines() == [
        "measured, not drawn: m7; m8",
        "drawn in some of the panels only: m1",
    ]
    # What is switched on or off changes no colour.
    assert _line(few, "m2").get_color() == _line(more, "m2").get_color()


def test_bad_input():
    with pytest.raises(ValueError, match=r"key must be .*, got 'rk5'"):
        Series("", [1.0], [1.0], "rk5")
    with pytest.raises(ValueError, match="must be that of x, 1, got 2"):
        Series("", [1.0], [1.0, 2.0])
    with pytest.raises(ValueError, match=r"scale must be .*, got 'loglog'"):
        Panel("", scale="loglog")


def test_cases_stand_at_the_axis_and_zeros_at_the_edge_of_a_logarithmic_one():
    panel = Panel("cases", ticks=(0, 1, 2), tick_names=("a", "b", "c"), scale="log y")
    panel.series = [Series("one", (0, 1, 2), (5.0, 0.0, 3.0)), Series("two", (0, 1, 2), (1, 0, 0))]
    (ax,) = draw([panel], figure=Figure()).axes
    assert [label.get_text() for label in ax.get_xticklabels()] == ["a", "b", "c"]
    triangles = [np.array(line.get_xydata()) for line in ax.lines if line.get_marker() == "v"]
    edges = {
        float(y): points[:, 0].tolist() for points in triangles for y in points[:, 1] if y < 0.2
    }
    assert [*edges.values()] == [[1], [1, 2]]
    # The second curve's triangles don't hide the first one's.
    assert len(edges) == 2
