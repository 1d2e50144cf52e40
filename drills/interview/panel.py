"""The cards in a notebook: a face, a button that turns it, four ratings; the state is kept.

    from drills.interview.panel import flashcards
    flashcards(chapters=[1], kinds=["claim"])

The state is that of `drills review`, in `reviews.json` beside the progress: it is changed by a
rating and by nothing else, so that running a cell again asks what is due and loses nothing.
"""

from __future__ import annotations

import html
import re
import threading
from collections.abc import Callable, Collection
from datetime import UTC, datetime
from typing import Any

import anywidget
import ipywidgets
import traitlets

from course.cards import tex
from course.check import one_of
from drills import json_store, workspace
from drills.interview import store
from drills.interview.deck import KINDS, Entry, deck, judge, sides
from drills.interview.store import AGAIN, GOOD, RATINGS
from drills.notebook import Shown

_HINT = {"claim": "t true, f false, o true only if", "formula": "your formula"}
_MATH = re.compile(r"\$\$?[^$]+\$\$?")
_WIDE = {"width": "auto"}


class Keys(anywidget.AnyWidget):
    """A strip that answers keys while it has the focus."""

    _esm = """
    export default { render({ model, el }) {
      const strip = document.createElement("div");
      strip.tabIndex = 0;
      strip.textContent = "Keys, once you have clicked here: space turns, 1 to 4 rate, n is next";
      strip.style.cssText = "padding:2px 8px;border:1px dashed #767676;font-size:12px";
      strip.dataset.lmSuppressShortcuts = "true";
      strip.addEventListener("keydown", (event) => {
        if (!model.get("_answered").includes(event.key)) return;
        event.preventDefault();
        event.stopPropagation();
        model.send({ key: event.key });
      });
      el.appendChild(strip);
    } };
    """
    _answered = traitlets.List(traitlets.Unicode(), [" ", "1", "2", "3", "4", "n"]).tag(sync=True)


class Flashcards(ipywidgets.VBox):
    """Cards one after the other: what is due, then what is new.

    Attributes:
        entry: the card that is shown, None when there is no more.
        turned: whether its other side is shown.
    """

    def __init__(self, cards: list[Entry], clock: Callable[[], datetime], seed: int) -> None:
        self._cards, self._clock = store.sequence(cards, seed), clock
        self._path = store.beside(workspace.progress_file(workspace.folder()))
        self._reviews, report = store.load(self._path)
        self._passed: set[str] = set()
        self._lock = threading.RLock()  # a front end may call from another thread than the cells
        self.entry: Entry | None = None
        self.turned = False
        self._head, self._face = ipywidgets.HTML(), ipywidgets.HTMLMath()
        self.answer_box = ipywidgets.Text(continuous_update=False, layout=_WIDE)
        self.turn = ipywidgets.Button(description="Reveal", button_style="primary", layout=_WIDE)
        self.next = ipywidgets.Button(description="Next", layout=_WIDE)
        self.ratings = {
            number: ipywidgets.Button(description=f"{number} {text}", layout=_WIDE)
            for number, text in RATINGS.items()
        }
        self.note = ipywidgets.Label(" ".join(report))
        self.strip = Keys()
        self.turn.on_click(lambda _: self.reveal())
        self.next.on_click(lambda _: self.skip())
        for number, button in self.ratings.items():
            button.on_click(lambda _, number=number: self.rate(number))
        self.strip.on_msg(lambda _widget, content, _buffers: self.press(content))
        row = ipywidgets.HBox([self.turn, self.next, *self.ratings.values()])
        super().__init__([self._head, self._face, self.answer_box, row, self.strip, self.note])
        self._deal()

    def reveal(self) -> None:
        """Turn the card; what was said of a claim or a formula is judged."""
        with self._lock:
            if self.entry is None or self.turned:
                return
            right, sentence = judge(self.entry, self.answer_box.value)
            if right is None and sentence:
                self.note.value = sentence  # what can't be read may be written again
                return
            self.turned = True
            if right is not None:
                self.ratings[GOOD if right else AGAIN].button_style = "info"
            shown = sides(self.entry, tex)
            message = f"**{html.escape(sentence)}**\n\n" if sentence else ""
            self._face.value = rendered(f"{shown.front}\n\n---\n\n{message}{shown.back}")
            self._enable()

    def rate(self, rating: int) -> None:
        """Keep a rating of the card, once it is turned, and show the next one."""
        with self._lock:
            if self.entry is None or not self.turned:
                return
            try:
                self._reviews, report = store.rate(
                    self._path, self.entry, rating, self._clock(), self._reviews
                )
            except json_store.Problem as problem:
                report = (f"{problem} The card is as it was.",)
                self._passed.add(self.entry.key)
            self.note.value = " ".join(report)
            self._deal()

    def skip(self) -> None:
        """Show the next card; this one is not rated."""
        with self._lock:
            if self.entry is not None:
                self._passed.add(self.entry.key)
                self._deal()

    def press(self, content: Any) -> None:
        """Handle a key; it is data of the browser, so it is checked before use."""
        key = str(content.get("key")) if isinstance(content, dict) else ""
        if key == " ":
            self.reveal()
        elif key == "n":
            self.skip()
        elif key in map(str, RATINGS):
            self.rate(int(key))

    def _deal(self) -> None:
        now = self._clock()
        line = store.queue(self._cards, self._reviews, now)
        line = [one for one in line if one.key not in self._passed]
        self.entry = store.following(line, self.entry)
        self.turned = False
        due = len(store.due(self._cards, self._reviews, now))
        new = len(store.fresh(self._cards, self._reviews))
        where = f"{self.entry.kind}, chapter {self.entry.chapter}" if self.entry else "No more now"
        self._head.value = f"<b>{where}</b> ({due} due, {new} new)"
        self._face.value = rendered(sides(self.entry, tex).front) if self.entry else ""
        self.answer_box.value = ""
        for button in self.ratings.values():
            button.button_style = ""
        self._enable()

    def _enable(self) -> None:
        hint = _HINT.get(self.entry.kind, "") if self.entry else ""
        self.answer_box.placeholder = hint
        self.answer_box.layout.display = None if hint and not self.turned else "none"
        self.turn.disabled = self.entry is None or self.turned
        self.next.disabled = self.entry is None
        for button in self.ratings.values():
            button.disabled = not self.turned

    def __repr__(self) -> str:
        return f"{len(self._cards)} cards, shown one at a time"

    def _repr_mimebundle_(self, **options: Any) -> Any:
        view = super()._repr_mimebundle_(**options)
        return {**(view if isinstance(view, dict) else view[0]), "text/plain": repr(self)}


def rendered(markdown: str) -> str:
    """Return Markdown as HTML; formulas between dollars stay as they are, for the page to set."""
    from markdown_it import MarkdownIt

    formulas: list[str] = []

    def selected(match: re.Match[str]) -> str:
        formulas.append(match[0])
        return f"\ue000{len(formulas) - 1}\ue001"

    page = (
        MarkdownIt("commonmark", {"html": False})
        .enable("table")
        .render(_MATH.sub(selected, markdown))
    )
    return re.sub("\ue000(\\d+)\ue001", lambda m: html.escape(formulas[int(m[1])]), page)


def flashcards(
    chapters: Collection[int] | None = None,
    kinds: Collection[str] = KINDS,
    seed: int = 0,
    clock: Callable[[], datetime] = lambda: datetime.now(UTC),
) -> Flashcards | Shown:
    """Return the cards of these chapters and kinds, or a sentence on what is missing.

    Args:
        chapters: their numbers, all if None.
        kinds: of `drills.interview.deck.KINDS`.
        seed: draws the order of new cards.
        clock: gives the time, aware.

    Raises:
        ValueError: for an unknown chapter or kind.
    """
    for kind in kinds:
        one_of("kind", kind, KINDS)
    cards = [entry for entry in deck(chapters) if entry.kind in kinds]
    try:
        import fsrs  # noqa: F401
    except ModuleNotFoundError:
        return Shown(f"The package fsrs is not installed; the cards need it: {workspace.set_up()}")
    return Flashcards(cards, clock, seed)
