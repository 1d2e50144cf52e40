"""What a pen writes is what painters read: items, ticks, numbers, and the PNG of matplotlib."""

from fractions import Fraction
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from course.simulations import pen as draw
from course.simulations.painter import to_png
from tests.budget import examples

pytestmark = pytest.mark.smoke


WORDS, COLOURS = draw.words_table(), draw.colours_table()
ENERGY, JOULE, ODD = WORDS("energy", " J", "E = $ m v² < 1")
RED, GREEN, BLUE = COLOURS("#ff0000", "#00ff00", "#0000ff")


def paper(width=400.0, room=2000):
    return draw.Paper("shapes", WORDS, COLOURS, (-1.0, 3.0, 0.0, 2.0), width, room=room)


def drawn(*steps, **options):
    """The picture that these calls of (function, arguments ...) draw."""
    sheet = paper(**options)
    pen = sheet.pen()
    for function, *arguments in steps:
        function(pen, *arguments)
    return draw.picture(sheet, pen)


CORNERS: list[Any] = [(draw.point, 0.0, 0.0), (draw.point, 1.0, 0.0), (draw.point, 1.0, 1.0)]
SHAPES: dict[str, list[Any]] = {
    "line": [(draw.line, RED, 3.0, 0.5, 4.0, 2.0), *CORNERS],
    "polygon": [(draw.polygon, GREEN, RED), *CORNERS],
    "disc": [(draw.disc, 0.25, BLUE), (draw.point, 0.5, 1.5)],
    "arrow": [(draw.arrow, 0.0, 0.0, 1.0, 1.0, RED)],
    "text": [(draw.text, 2.0, 1.0, ODD), (draw.number, 2.5, 1, JOULE)],
}


def test_items_come_back_as_they_were_drawn():
    steps = [step for shape in SHAPES.values() for step in shape]
    items = list(draw.decode(drawn(*steps)))
    assert [item.kind for item in items] == [
        draw.LINE,
        draw.POLYGON,
        draw.DISC,
        draw.ARROW,
        draw.TEXT,
    ]
    assert items[0].style == (RED, 3.0, 0.5, 4.0, 2.0)
    assert items[1].points.T.tolist() == [[0, 0], [1, 0], [1, 1]]
    assert items[3].points.T.tolist() == [[0, 0], [1, 1]]
    assert items[4].words == "E = $ m v² < 12.5 J" and items[4].points[:, 0].tolist() == [2, 1]


def test_an_area_takes_values_to_its_place_until_the_window_is_back():
    present, values = (1.0, 3.0, 0.5, 1.0), (-10.0, 10.0, 0.0, 5.0)
    x, y = np.array([-10.0, 0.0, np.nan]), np.array([5.0, 2.5, 1.0])
    points: list[Any] = [(draw.line, RED), (draw.points, x, y)]
    cut, line, back, plain = draw.decode(
        drawn((draw.area, present, values), *points, (draw.window,), *points)
    )
    assert cut.kind == back.kind == draw.CUT
    assert cut.points.tolist() == [[1.0, 3.0], [0.5, 1.0]] and back.points.size == 0
    assert line.points[:, :2].T.tolist() == [[1.0, 1.0], [2.0, 0.75]]
    assert np.isnan(line.points[0, 2])
    assert plain.points[:, :2].T.tolist() == [[-10.0, 5.0], [0.0, 2.5]]
    assert draw.values_at(present, values, 2.0, 0.75) == (0.0, 2.5)


def test_axes_have_grid_ticks_and_labels_and_leave_the_area_as_it_was():
    area = ((0.0, 2.0, 0.5, 1.5), (0.0, 10.0, -0.5, 0.5))
    picture = drawn(
        (draw.area, *area),
        (draw.axes, ENERGY, ODD, JOULE, 2, 2),
        (draw.line, RED),
        (draw.point, 5.0, 0.0),
    )
    items = list(draw.decode(picture))
    words = {item.words: item for item in items if item.kind == draw.TEXT}
    assert {"0", "5", "10", "−0.5", "0.0", "0.5", "energy", " J"} <= set(words)
    assert words["5"].points[:, 0].tolist() == [1.0, 0.5]
    assert items[-1].points[:, 0].tolist() == [1.0, 1.0]
    assert items[-2].kind == draw.CUT and items[-2].points.size == 4
    bare = drawn((draw.area, *area), (draw.axes, 0, 0, 0, 0, 0))
    assert [item.kind for item in draw.decode(bare)] == [draw.CUT, draw.CUT, draw.LINE, draw.CUT]


def test_readouts_are_numbers_by_name():
    picture = drawn((draw.reading, ENERGY, -0.125, draw.SIGNED + 2, JOULE))
    assert picture.numbers == {"energy": "−0.13 J"}
    assert picture.text == "shapes\n  energy: −0.13 J"


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (1.005, 2, "1.00"),
        (2.5, 0, "3"),
        (-2.5, 0, "−3"),
        (-0.001, 2, "0.00"),
        (3, 0, "3"),
        (0.0, draw.SIGNED + 1, "+0.0"),
        (2.0, draw.SIGNED, "+2"),
        (-2.0, draw.SIGNED, "−2"),
        (-1e-9, draw.SIGNED + 2, "+0.00"),
        (153307.0000005, 7, "153307.0000005"),
        (1.5e9, draw.EXPONENT + 1, "1.5e9"),
        (9.99e-7, draw.EXPONENT + 1, "1.0e−6"),
        (0.0, draw.EXPONENT + 2, "0.00e0"),
        (2e21, 1, "2.0e21"),
        (1e20, 9, "1" + 20 * "0" + "." + 9 * "0"),
    ],
)
def test_numbers_as_they_are_written(value, form, text):
    assert draw.written(value, form) == text


def decimal(k, factor, power):
    return Fraction(int(k)) * int(factor) * Fraction(10) ** int(power)


magnitudes = st.one_of(st.floats(-1e6, 1e6), st.floats(-1e200, 1e200), st.floats(-1e-6, 1e-6))
spans = st.floats(-200.0, 200.0).map(lambda power: 10.0**power)


@pytest.mark.slow
@examples(300)
@given(magnitudes, spans, st.integers(1, 12))
@example(153307.0, 1e-6, 2)
@example(0.30000000000000004, 0.1, 1)
@example(-1.0, 2.0, 10)
@example(1e16, 4.0, 2)
@example(-4.403271235963565e-07, 1e-22, 1)
def test_ticks_are_all_round_numbers_of_the_axis(low, span, count):
    high = low + span
    assume(high > low)
    first, last, factor, power = draw.ticks(low, high, count)
    step = decimal(1, factor, power)
    if last < first:  # where floats can't tell the ticks apart, or there is none of that step
        # The step is at least the span over the count, and is told apart from 1e-15 of the values.
        coarse = max(abs(low), abs(high)) > 0.99e15 * (high - low) / count
        assert (factor == 1.0 and power == 0.0 and coarse) or np.ceil(low / float(step)) > last
        return
    assert factor in (1.0, 2.0, 5.0) and last - first <= count
    exact_span = Fraction(high) - Fraction(low)
    # The smallest such step with at most `count` of them in the span.
    smaller = step * {1: Fraction(1, 2), 2: Fraction(1, 2), 5: Fraction(2, 5)}[int(factor)]
    assert step * count >= exact_span * (1 - Fraction(1, 10**8))
    assert smaller * count < exact_span * (1 + Fraction(1, 10**8))
    slack = step / 10**8 + Fraction(float(np.spacing(max(abs(low), abs(high)))))
    ks = range(int(first), int(last) + 1)
    assert all(low - slack <= decimal(k, factor, power) <= high + slack for k in ks)
    assert decimal(first - 1, factor, power) < low + slack
    assert decimal(last + 1, factor, power) > high - slack
    result = [float(draw.tick(float(k), factor, power)) for k in ks]
    near = 1 if -22 <= power <= 22 else 4  # powers of ten beyond are not exact
    for k, value in zip(ks, result, strict=True):
        exact = float(decimal(k, factor, power))
        assert abs(value - exact) <= near * np.spacing(abs(exact))
    assert (np.diff(result) > 0.0).all()
    form, letters = draw.tick_form(max(abs(low), abs(high)), power)
    if form % 20 < 15:
        words = [draw.written(value, int(form)) for value in result]
        assert len(set(words)) == len(words)
        assert max(len(word.strip("−")) for word in words) <= letters + 4


def test_ticks_of_known_axes():
    def values(*axis):
        first, last, factor, power = draw.ticks(*axis)
        return [draw.tick(first + k, factor, power) for k in range(int(last - first) + 1)]

    assert values(0.0, 3.07, 5) == [0.0, 1.0, 2.0, 3.0]
    assert values(-0.2, 1.0, 6) == [-0.2, 0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    assert values(153307.0, 153307.000001, 3) == [153307.0, 153307.0000005, 153307.000001]
    assert values(0.0, 1.0, 0) == values(0.0, 0.0, 5) == values(0.0, np.inf, 5) == []
    assert values(1e16, 1e16 + 4.0, 8) == []


def test_a_history_forgets_its_older_half():
    history, count = np.zeros((2, 6)), 0
    for k in range(8):
        count = draw.remember(history, count, float(k))
        history[1, count - 1] = 10.0 * k
    assert history[:, :count].tolist() == [[3, 4, 5, 6, 7], [30, 40, 50, 60, 70]]


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: draw.Paper("x", window=(0, 1, 1, 1)), "window"),
        (lambda: draw.Paper("x", window=(0, 1, 0, np.inf)), "window"),
        (lambda: paper(width=0.0), "width"),
        (lambda: drawn(*SHAPES["arrow"], room=9), "room .* an arrow"),
        (lambda: drawn((draw.line, RED), *CORNERS, room=12), "room .* a line"),
        (lambda: drawn((draw.copy, np.zeros(9)), room=8), "room .* copy"),
        (lambda: drawn((draw.point, 0.0, 0.0)), "before the item"),
        (lambda: drawn((draw.points, np.empty(0), np.empty(0)), room=0), "before the item"),
        (lambda: list(draw.decode(draw.Picture(paper(), np.array([9.0, 0.0])))), "kind 9"),
        (lambda: list(draw.decode(draw.Picture(paper(), np.array([1.0, 8.0])))), "8 numbers"),
        (lambda: list(draw.decode(draw.Picture(paper(), np.array([0.0, 1.0, 3.0])))), "kind 0"),
    ],
)
def test_what_cannot_be_drawn_is_named(make, named):
    with pytest.raises(ValueError, match=named):
        make()


def image(picture, sharpness=1.0):
    import matplotlib.image

    return matplotlib.image.imread(BytesIO(to_png(picture, sharpness)), format="png")


def colour_at(pixels, x, y):  # 100 pixels per unit, row 0 on top
    return pixels[int(200 - 100 * y), int(100 * (x + 1))][:3].tolist()


def test_png_has_the_colours_where_the_world_has_them():
    pixels = image(
        drawn((draw.box, 0.0, 1.0, 0.0, 1.0, RED), (draw.disc, 0.5, BLUE), (draw.point, 2.0, 1.0))
    )
    assert pixels.shape[:2] == (200, 400)
    assert colour_at(pixels, 0.5, 0.5) == [1, 0, 0]
    for x, y in ((2.0, 1.0), (2.4, 1.0), (2.0, 1.4)):
        assert colour_at(pixels, x, y) == [0, 0, 1]
    for x, y in ((2.6, 1.0), (0.5, 1.5), (-0.5, 0.5)):
        assert colour_at(pixels, x, y) == [1, 1, 1]


def test_png_cuts_shapes_at_the_edges_of_an_area_and_words_never():
    rectangle = (0.0, 1.0, 0.0, 1.0)
    big: list[Any] = [(draw.box, -9.0, 9.0, -9.0, 9.0, RED)]
    pixels = image(drawn((draw.area, rectangle, rectangle), *big, (draw.text, 1.5, 1.5, ODD)))
    assert colour_at(pixels, 0.5, 0.5) == [1, 0, 0] and colour_at(pixels, 1.1, 0.5) == [1, 1, 1]
    assert (pixels[30:70, 250:] != 1.0).any()
    back = image(drawn((draw.area, rectangle, rectangle), (draw.window,), *big))
    assert colour_at(back, 2.5, 0.5) == [1, 0, 0]


def test_png_is_the_same_each_time_and_draws_every_kind():
    steps = [step for shape in SHAPES.values() for step in shape]
    assert to_png(drawn(*steps)) == to_png(drawn(*steps))
    assert (image(drawn()) == 1.0).all()
    for name, shape in SHAPES.items():
        assert (image(drawn(*shape)) != 1.0).any(), name


def test_png_has_the_numbers_below_the_picture():
    readings: list[Any] = [(draw.reading, word, 1.0, 2) for word in (ENERGY, JOULE, ODD)]
    pixels = image(drawn(*readings, width=300.0))
    assert (pixels[:150] == 1.0).all()
    assert pixels.shape[0] > 150 + 60  # two rows of them
    assert (pixels[150:194] != 1.0).any() and (pixels[194:] != 1.0).any()
