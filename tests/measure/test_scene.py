"""A scene must say when it models too little and when too much. Truth: closed forms of a fall."""

import math

import pytest

from course.measure.scene import LeftOut, Modelled, Scene, Tolerance

pytestmark = pytest.mark.smoke


GRAVITY = 9.81


def _fall_time(height, drag_length):
    """Fall from rest with drag v^2 / drag_length: cosh(t sqrt(g/L)) = exp(h/L)."""
    if math.isinf(drag_length):
        return math.sqrt(2.0 * height / GRAVITY)
    return math.acosh(math.exp(height / drag_length)) * math.sqrt(drag_length / GRAVITY)


def _ball(height, tolerance):
    """How long does a small steel ball fall? Air left out, gravity's decrease with height kept."""
    vacuum = _fall_time(height, math.inf)
    air = LeftOut(
        "air drag",
        lambda: abs(_fall_time(height, 300.0) - vacuum),
        "s",
        saves=1.5,
        against="closed form with quadratic drag",
    )
    return Scene(
        "How long does the ball fall?",
        Tolerance(tolerance, "s", "a hand-held stopwatch resolves this"),
        ["height"],
        left_out=[air],
    )


def test_air_may_be_left_out_of_a_short_fall_only():
    assert _ball(1.0, 0.01).check() == []
    (finding,) = _ball(20.0, 0.01).check()
    assert finding.startswith("models too little: leaving out air drag")
    # To first order drag delays a fall by t h / (6 L).
    scene = _ball(1.0, 0.01)
    assert scene.left_out[0].measured() == pytest.approx(_fall_time(1, math.inf) / 1800, rel=0.01)


def test_what_changes_nothing_is_too_much():
    scene = _ball(1.0, 0.01)
    scene.modelled = [
        Modelled("gravity", math.inf, "s"),
        Modelled("the earth's curvature", lambda: 1e-7, "s", saves=3.0, against="radial gravity"),
    ]
    (finding,) = scene.check()
    assert finding.startswith("models too much: without the earth's curvature")


def test_many_small_omissions_add_up():
    scene = _ball(1.0, 0.01)
    scene.left_out = [LeftOut(f"effect {i}", 0.004, "s") for i in range(3)]
    (finding,) = scene.check()
    assert "together" in finding
    # An effect small in itself has to stay when the rest has used the tolerance up.
    scene.left_out = [LeftOut("one", 0.009, "s")]
    scene.modelled = [Modelled("two", 0.002, "s")]
    assert scene.check() == []


def test_an_error_is_measured_once():
    values = iter([0.5, 0.7])
    item = LeftOut("x", lambda: next(values), "m")
    assert (item.measured(), item.measured()) == (0.5, 0.5)


def test_text():
    scene = _ball(60.0, 0.01)
    assert "air drag" in scene.table() and "models too little" in scene.table()
    markdown = scene._repr_markdown_()
    row = next(line for line in markdown.splitlines() if line.startswith("| air drag"))
    assert "left out" in row and "1.5x" in row and row.count("|") == 6
    assert set(scene._repr_mimebundle_()) == {"text/plain", "text/markdown"}


def test_bad_input():
    with pytest.raises(ValueError, match=r"value must be a positive"):
        Tolerance(0.0, "m", "x")
    with pytest.raises(ValueError, match="why"):
        Tolerance(1.0, "m", " ")
    with pytest.raises(ValueError, match="question"):
        Scene("Fall.", Tolerance(1.0, "m", "x"), ["z"])
    with pytest.raises(ValueError, match="unit"):
        Scene("Far?", Tolerance(1.0, "m", "x"), ["z"], left_out=[LeftOut("air", 1.0, "s")])
    with pytest.raises(ValueError, match="air"):
        LeftOut("air", math.nan, "m").measured()
