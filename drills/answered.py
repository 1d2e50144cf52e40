"""What a reader answers on the cards of a notebook, kept in the progress file.

A card is HTML without a script (`course.derivations.markup`). One `Listener` in a notebook, below
its badges, is notified by the page which answer of which card was opened. The first answer counts:
after it the explanation has been read.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import anywidget
import traitlets

from course import CHAPTERS, cards
from course.derivations import ANSWERS, records
from drills.progress import Reading

# Told once for the whole notebook, as cards may be drawn before or after it. A click on an answer
# unfolds the explanation, too. JupyterLab has removed the cards' data- attributes: the id names the
# card, and the order of its answers names the answer.
_SCRIPT = """
const ANSWER = "details.answer"
function render({ model, el }) {
  const page = el.closest(".jp-Notebook") ?? document.body
  const report = (answer) => {
    const card = answer.closest(".card")
    if (!card?.id) return
    card.querySelector("details.why")?.setAttribute("open", "")
    model.send({ card: card.id, answer: [...card.querySelectorAll(ANSWER)].indexOf(answer) })
  }
  const toggled = (event) => {
    if (event.target.matches?.(ANSWER) && event.target.open) report(event.target)
  }
  // Cards are drawn at any time: each is marked once, when it is there.
  const mark = () => {
    for (const [id, place] of Object.entries(model.get("given"))) {
      const answer = page.querySelector(`[id="${id}"]`)?.querySelectorAll(ANSWER)[place]
      const summary = answer?.querySelector("summary")
      if (!summary || summary.querySelector(".given")) continue
      const note = document.createElement("span")
      note.className = "given"
      note.textContent = " (your first answer)"
      summary.append(note)
    }
  }
  const drawn = new MutationObserver(mark)
  drawn.observe(page, { childList: true, subtree: true })
  const score = () => {
    el.textContent = model.get("score")
    mark()
  }
  page.addEventListener("toggle", toggled, true)  // such events don't bubble
  page.querySelectorAll(`${ANSWER}[open]`).forEach(report)
  model.on("change:score", score)
  score()
  return () => {
    page.removeEventListener("toggle", toggled, true)
    model.off("change:score", score)
    drawn.disconnect()
  }
}
export default { render }
"""


@functools.cache
def _answers() -> dict[str, tuple[int, str, tuple[tuple[str, bool], ...]]]:
    """Return for the id of each card its chapter's number, its name and its answers."""
    numbers = {chapter.topic: chapter.number for chapter in CHAPTERS}
    result = {}
    for topic, number in numbers.items():
        if not (cards.FOLDER / f"{topic}.toml").is_file():
            continue
        for name, card in cards.predictions(topic).items():
            options = tuple((option.label, option.right) for option in card.options)
            result[f"card-{name}"] = (number, f"{topic}.{name}", options)
    for file in records.files():
        topic = file.partition(".")[0]
        for name, entry in records.load(file).items():
            options = tuple(
                (label, verdict.value == entry["verdict"]) for label, verdict in ANSWERS.items()
            )
            result[f"claim-{name}"] = (numbers[topic], f"{topic}.{name}", options)
    return result


def note(reading: Reading, card: str, answer: int) -> None:
    """Enter the answer to a card into the record of the chapter whose page it is on.

    The first answer counts.

    Args:
        reading: changed in place.
        card: id of the card's element.
        answer: number of the answer, from 0.

    Raises:
        ValueError: for an unknown card or answer.
    """
    _, name, options = _answers().get(card, (0, "", ()))
    if not 0 <= answer < len(options):
        raise ValueError(f"card and answer must be on a page of the course, got {card}, {answer}")
    label, right = options[answer]
    reading.cards.setdefault(name, {"answer": label, "right": right})


def score(reading: Reading) -> str:
    """Return how many cards were answered right, as a sentence; "" before the first answer."""
    count = len(reading.cards)
    if not count:
        return ""
    right = sum(card["right"] for card in reading.cards.values())
    return f"Cards: {right} of {count} answered right at the first try."


def given(reading: Reading) -> dict[str, int]:
    """Return for the id of each card that was answered which answer was the first."""
    result = {}
    for at, (_, name, options) in _answers().items():
        labels = [label for label, _ in options]
        if name in reading.cards and reading.cards[name]["answer"] in labels:
            result[at] = labels.index(reading.cards[name]["answer"])
    return result


class Listener(anywidget.AnyWidget):
    """Hear which answers are opened in the notebook that shows this, and show the score.

    Attributes:
        score: the sentence below the badges.
        given: id of a card -> number of the answer that was given first; the page marks it.
    """

    _esm = _SCRIPT
    given = traitlets.Dict().tag(sync=True)
    score = traitlets.Unicode().tag(sync=True)

    def __init__(self, reading: Reading, store: Callable[[str, int], Reading]) -> None:
        """Show the score of `reading`; `store` saves an answer and returns the new record."""
        super().__init__(given=given(reading), score=score(reading))
        self._store = store
        self.on_msg(self._on_message)

    def _on_message(self, _widget: Any, content: Any, _buffers: Any) -> None:
        try:
            card, answer = str(content["card"]), int(content["answer"])
            reading = self._store(card, answer)
            self.given, self.score = given(reading), score(reading)
        except (KeyError, TypeError, ValueError):
            return  # a card that somebody else has put on the page
