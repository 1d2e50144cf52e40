"""Both painters draw the same: canvas.js in a real browser against matplotlib, for every model."""

import base64
from io import BytesIO
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from course.simulations import canvas as widget
from course.simulations import pen as draw
from course.simulations.model import Experiment
from course.simulations.painter import to_png
from tests.simulations.models import MODELS
from tests.simulations.test_browser import browser_page  # noqa: F401

pytestmark = pytest.mark.browser

PAINT = """([paper, data, wide]) => {
  const canvas = document.createElement("canvas");
  const bytes = Uint8Array.from(atob(data), c => c.charCodeAt(0));
  const readouts = window.painter.paint(canvas, paper, new Float64Array(bytes.buffer), wide);
  return [readouts, canvas.toDataURL("image/png").split(",")[1]];
}"""


def in_browser(page: Any, picture: draw.Picture) -> tuple[dict[str, str], Any]:
    """The readouts and the pixels."""
    report = widget.Canvas(picture)._paper
    data = base64.b64encode(picture.data.tobytes()).decode()
    readouts, png = page.evaluate(PAINT, [report, data, picture.paper.width])
    pixels = matplotlib.image.imread(BytesIO(base64.b64decode(png)), format="png")
    return dict(readouts), pixels[..., :3]


def blurred(pixels: Any, by: int = 8) -> Any:
    """Means over squares: letters and edges differ by a pixel, what stands where does not."""
    rows, columns = pixels.shape[0] // by, pixels.shape[1] // by
    cut = pixels[: rows * by, : columns * by]
    return cut.reshape(rows, by, columns, by, 3).mean(axis=(1, 3))


def without_words(picture: draw.Picture) -> draw.Picture:
    """Words are a few pixels wider in another program; shapes are only moved to whole pixels."""
    retained, at = [], 0
    while at < picture.data.size:
        end = at + 2 + int(picture.data[at + 1])
        if picture.data[at] != draw.TEXT:
            retained.append(picture.data[at:end])
        at = end
    return draw.Picture(picture.paper, np.concatenate(retained))


@pytest.mark.parametrize("model", MODELS)
def test_both_painters_draw_the_same_picture(page: Any, model: Any) -> None:
    for preset in model.presets.values():
        experiment = Experiment(model, **preset.values)
        for _ in range(2):
            picture = experiment.picture()
            for shown, largest, share in (
                (picture, 0.5, 0.01),
                (without_words(picture), 0.3, 0.004),
            ):
                text, browser = in_browser(page, shown)
                assert text == picture.numbers
                still = matplotlib.image.imread(BytesIO(to_png(shown, 1.0)), format="png")
                still = still[: browser.shape[0], :, :3]
                difference = np.abs(blurred(browser) - blurred(still)).max(axis=-1)
                # The more is drawn, the more letters differ: up to a tenth of what is drawn on.
                drawn = (blurred(still) < 0.9).any(axis=-1).mean()
                assert drawn > 0.0
                allowed = share * max(1.0, 10.0 * drawn)
                assert difference.max() < largest and (difference > 0.12).mean() < allowed
            experiment.advance(1.3)
