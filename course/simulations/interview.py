"""Mock interview questions against a timer, and how fast the answers are forgotten.

A question is answered aloud while a timer runs, then revealed, then rated. The rating sets the next
review at once: beside the card is the chance to recall it, by the model of memory behind
`drills review` (FSRS 6, as in the library fsrs with its default weights; Ye, Su and Cao, KDD 2022),
here without its steps within a day. A card is rated only after it was revealed. Days pass at the
speed that is set, and none of them while the timer runs.
"""

import math
import textwrap
import tomllib
from pathlib import Path

import numpy as np
from numba.extending import register_jitable

from course.interview import FOLDER as QUESTIONS
from course.interview import read
from course.interview.fields import estimate
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider, switch

AGAIN, HARD, GOOD, EASY = 1, 2, 3, 4
WEIGHTS = (
    0.212,
    1.2931,
    2.3065,
    8.2956,
    6.4133,
    0.8334,
    3.0194,
    0.001,
    1.8722,
    0.1666,
    0.796,
    1.4835,
    0.0614,
    0.2629,
    1.6483,
    0.6014,
    1.8729,
    0.5425,
    0.0912,
    0.0658,
    0.1542,
)
W = np.array(WEIGHTS)
WANTED = 0.9  # chance to recall at which a card is asked again
# The factor that makes the forgetting curve 0.9 after as many days as the stability.
_FACTOR = 0.9 ** (-1.0 / WEIGHTS[20]) - 1.0
_LEAST, _MOST = 0.001, 36500.0  # days

# --- Memory ---------------------------------------------------------------------------------------


@register_jitable
def recall(days, stability):
    """Return the chance to recall a card `days` after its review; 0.9 after `stability` days."""
    # FSRS: a power law of forgetting.
    return (1.0 + _FACTOR * days / stability) ** -W[20]


@register_jitable
def interval(stability):
    """Return days until a card is asked again: whole ones, one at least."""
    return min(max(np.round(stability), 1.0), _MOST)


@register_jitable
def _first_difficulty(rating):
    return W[4] - math.exp(W[5] * (rating - 1)) + 1.0


@register_jitable
def first(rating):
    """Return stability [days] and difficulty (1 to 10) after the first rating."""
    return W[rating - 1], min(max(_first_difficulty(rating), 1.0), 10.0)


@register_jitable
def after(stability, difficulty, days, rating):
    """Return stability and difficulty after a rating, `days` whole days after the last one."""
    # A review on the same day: a short-term formula without the chance of recall.
    if days < 1.0:
        growth = math.exp(W[17] * (rating - 3 + W[18])) * stability ** -W[19]
        new = stability * (growth if rating == AGAIN else max(growth, 1.0))
    elif rating == AGAIN:
        # Forgotten: the stability falls, to more for stable and easy cards; it cannot rise.
        lost = math.exp((1.0 - recall(days, stability)) * W[14])
        slow = W[11] * difficulty ** -W[12] * ((stability + 1.0) ** W[13] - 1.0) * lost
        new = min(slow, stability / math.exp(W[17] * W[18]))
    else:
        # Recalled: stability grows more if recall had become unlikely (spacing effect), less for
        # difficult and for stable cards.
        late = math.exp((1.0 - recall(days, stability)) * W[10]) - 1.0
        gain = math.exp(W[8]) * (11.0 - difficulty) * stability ** -W[9] * late
        gain *= W[15] if rating == HARD else 1.0
        gain *= W[16] if rating == EASY else 1.0
        new = stability * (1.0 + gain)
    # Difficulty moves against the rating, less near 10 (linear damping), and reverts to that of an
    # easy first rating.
    moved = difficulty - W[6] * (rating - 3) * (10.0 - difficulty) / 9.0
    moved = W[7] * _first_difficulty(EASY) + (1.0 - W[7]) * moved
    return max(new, _LEAST), min(max(moved, 1.0), 10.0)


# --- What there is to set and to see --------------------------------------------------------------

ALLOWED = 60.0  # seconds to answer
DRILLS = ("fk3", "rrt", "pid")
_CATALOGUE = Path(__file__).parents[2] / "drills" / "catalogue"
_NAMED = ("gate", *DRILLS)
_ASKED = ("trials_for_a_gate", "three_link_chain", "tree_in_the_plane", "pid_that_lets_go")
_FRONT = [read(QUESTIONS / "interview" / f"{name}.md").title for name in _ASKED]
_BACK_OF_GATE = (
    f"One-sided at five per cent: it passes, just. A policy exactly at the gate reaches "
    f"{estimate('gate_bar'):.0f} or more with probability {estimate('gate_chance'):.1%}. "
    f"Two-sided, the rate is {estimate('gate_low'):.0%} to {estimate('gate_high'):.0%}. Say which "
    f"test you mean before the number. Better: {estimate('gate_trials'):.0f} trials, of which "
    f"{estimate('gate_trials_bar'):.0f} must succeed."
)
_INSIGHTS = [
    tomllib.loads((_CATALOGUE / name / "card.toml").read_text("utf-8"))["insight"]
    for name in DRILLS
]
_ROWS, _WIDE = 8, 48  # lines and letters on a card
NOBODY, WHEN_DUE, DAILY = range(3)
# With which rating the four cards were rated first where you review them, and how many days ago.
_FIRST = np.array([GOOD, EASY, HARD, GOOD])
_AGO = np.array([0.5, 6.0, 1.8, 2.2])

CONTROLS = Record(
    card=menu("Question", _NAMED, live=True),
    turned=switch("Revealed", False, live=True),
    reviewer=menu("Reviews by themselves", ("none", "when due", "every day")),
    rating=menu("Rated then", ("again", "hard", "good", "easy"), 2),
    speed=slider("Speed", 0.0, 0.0, 10.0, 0.5, "days/s", live=True),
)
STATE = Record(
    time=Field(0.0, unit="days"),
    answering=Field(0.0, unit="s"),
    since=Field(0.0, shape=(4,)),
    stability=Field(1.0, shape=(4,)),
    difficulty=Field(5.0, shape=(4,)),
    reviews=Field(0, shape=(4,)),
)

TITLE = "Mock interview questions against a timer"
word, colour = draw.words_table(), draw.colours_table()


def _face(text: str) -> int:
    # A face always has the same number of lines, so that the picture can count on its words.
    lines = textwrap.wrap(text, _WIDE)
    return word(*(lines + [" "] * (_ROWS - len(lines))))[0]


_NAMES = word(
    "Mock question: a gate",
    "Mock question: forward kinematics",
    "Mock question: RRT",
    "Mock question: PID",
)[0]
_FRONTS = np.array([_face(f"{front} Answer aloud.") for front in _FRONT])
_BACKS = np.array([_face(text) for text in (_BACK_OF_GATE, *_INSIGHTS)])
_RATINGS = word("again", "hard", "good", "easy")[0]
_SHORT = word(*_NAMED)[0]
(
    _DAYS,
    _CHANCE,
    _HEAD,
    _NOW,
    _STABLE,
    _HARD,
    _NEXT,
    _COUNT,
    _UNIT,
    _NEVER,
    _OF,
    _LEFT,
    _SECONDS,
    _REVEAL,
    _STOPPED,
    _RATE,
) = word(
    "days since the last review",
    "chance to recall",
    "How the answer is forgotten",
    "chance now",
    "down to 90 % after",
    "difficulty (1 to 10)",
    "asked again after",
    "reviews of all four",
    " days",
    "never rated",
    "chance to recall each card (orange: below 90 %)",
    "time left to answer",
    " s",
    "Reveal",
    "revealed",
    "How well did you know it?",
)
_PAPER, _BACK = colour("#eef3f7", "#fbe3c8")
_CARD = (0.2, 4.4, 1.5, 4.6)
_TIMER = (1.36, 1.44)  # bottom and top of the timer's bar, below the card
_PLOT = (5.3, 8.8, 2.3, 4.4)
_AT = (0.2, 1.0)  # of the buttons


def initial(controls, state):
    """Set up the cards: rated some days ago where you review them, else never rated."""
    state["time"] = state["answering"] = 0.0
    if controls["reviewer"] == NOBODY:
        for k in range(4):
            rate(state, k, _FIRST[k])
            state["since"][k] = _AGO[k]


@register_jitable
def rate(state, k, rating):
    """Rate a card now."""
    if state["reviews"][k] == 0:
        known, hard = first(rating)
    else:
        # Within a day the number of whole days is 0, which selects the short-term formula.
        days = math.floor(state["since"][k])
        known, hard = after(state["stability"][k], state["difficulty"][k], days, rating)
    state["stability"][k], state["difficulty"][k] = min(known, _MOST), hard
    state["since"][k] = 0.0
    state["reviews"][k] += 1


def advance(state, controls, seconds):
    """Advance the timer and the days; automatic reviews happen at the end of a day."""
    if controls["reviewer"] == NOBODY and not controls["turned"]:
        state["answering"] = min(state["answering"] + seconds, ALLOWED)
    remaining = seconds * controls["speed"]
    # Advance from one end of a day to the next: reviews happen there only.
    while remaining > 0.0:
        step = min(remaining, 1.0 - state["time"] % 1.0)
        remaining -= step
        state["time"] += step
        state["since"] += step
        if controls["reviewer"] == NOBODY or state["time"] % 1.0 > 1e-9:
            continue
        # Remove accumulated rounding, since the intervals are whole days.
        state["time"] = np.round(state["time"])
        for k in range(4):
            wait = interval(state["stability"][k]) if controls["reviewer"] == WHEN_DUE else 1.0
            if state["reviews"][k] == 0 or state["since"][k] >= wait - 1e-6:
                state["since"][k] = np.round(state["since"][k])
                rate(state, k, controls["rating"] + 1)


def drag(controls, state, x, y):
    """Handle a drag: nothing moves with the pointer; what counts is where it went down."""


def grab(controls, state, x, y):
    """Handle a press of the pointer: a click on the card, or on its Reveal, turns it.

    On a button it rates the card, once that is turned.
    """
    left, right, bottom, top = _CARD
    if left <= x <= right and bottom <= y <= top:
        controls["turned"] = 1 - controls["turned"]
    chosen = draw.button_at(_AT[0], _AT[1], 4, x, y)
    if chosen >= 0:
        _rated(controls, state, chosen + 1)


@register_jitable
def _rated(controls, state, rating):
    # A rating counts only after the answer was visible.
    if controls["turned"]:
        rate(state, controls["card"], rating)
        _deal(controls, state)


@register_jitable
def _deal(controls, state):
    # The next question, with the whole time to answer it.
    controls["card"] = (controls["card"] + 1) % 4
    controls["turned"] = 0
    state["answering"] = 0.0


def press(controls, state, key):
    """Handle a key: left reveals the answer, right takes the next question.

    The four keys -, down, up and + grade the answer again, hard, good and easy.
    """
    if key == 0:
        controls["turned"] = 1 - controls["turned"]
    elif key == 1:
        _deal(controls, state)
    else:
        _rated(controls, state, (GOOD, HARD, EASY, AGAIN)[key - 2])


def frame(pen, state, controls):
    """Draw the card, its forgetting, and the chance to recall each of the four."""
    k, turned = controls["card"], controls["turned"]
    left, right, bottom, top = _CARD
    draw.box(pen, left, right, bottom, top, _BACK if turned else _PAPER, draw.INK, 1.5)
    draw.text(
        pen,
        left + 0.15,
        top - 0.25,
        _NAMES + k,
        draw.INK,
        13.0,
        draw.LEFT,
        draw.MIDDLE,
        0.0,
        0.0,
        0.0,
        1.0,
    )
    face = (_BACKS if turned else _FRONTS)[k]
    for row in range(_ROWS):
        draw.text(pen, left + 0.15, top - 0.6 - 0.27 * row, face + row, draw.INK, 12.0)
    if turned:
        draw.buttons(pen, _AT[0], _AT[1], _RATINGS, 4)
        draw.text(pen, left + 0.15, 0.78, _RATE, draw.INK, 12.0)
    else:
        draw.buttons(pen, right - draw.BUTTON, bottom + 0.1, _REVEAL, 1)
        # The bar shrinks with the time that is left, and turns orange near its end.
        share = 1.0 - state["answering"] / ALLOWED
        ink = draw.BLUE if share > 0.2 else draw.ORANGE
        draw.box(pen, left, left + (right - left) * share, _TIMER[0], _TIMER[1], ink)
    known, since = state["stability"][k], state["since"][k]
    observed = state["reviews"][k] > 0
    # The chart shows two intervals at least, and the time since the last review.
    far = 1.25 * max(since, 2.0 * interval(known), 4.0)
    draw.chart(pen, _PLOT, (0.0, far, 0.0, 1.0), _DAYS, _CHANCE, _HEAD)
    if observed:
        days = np.linspace(0.0, far, 60)
        draw.curve(pen, days, recall(days, known), draw.BLUE, 2.2)
        # The spot has the colour of the card's bar: orange once the card is due by its chance.
        here = recall(since, known)
        ink = draw.BLUE if here >= WANTED else draw.ORANGE
        draw.spot(pen, since, here, 0.015 * far, ink, draw.INK)
    draw.segment(pen, 0.0, WANTED, far, WANTED, draw.INK, 1.4, 0.8, 5.0, 4.0)
    draw.window(pen)
    draw.text(pen, 5.3, 1.35, _OF, draw.INK, 12.0)
    for one in range(4):
        x = 5.3 + 0.9 * one
        now = recall(state["since"][one], state["stability"][one])
        # Cards that were never rated have no chance of recall.
        now *= state["reviews"][one] > 0
        draw.box(pen, x, x + 0.7, 0.45, 1.15, draw.FAINT)
        ink = draw.BLUE if now >= WANTED else draw.ORANGE
        draw.box(pen, x, x + 0.7, 0.45, 0.45 + 0.7 * now, ink)
        draw.text(pen, x + 0.35, 0.25, _SHORT + one, draw.INK, 11.0, draw.CENTRE)
    shown = _STOPPED if turned else 0
    draw.reading(pen, _LEFT, ALLOWED - state["answering"], 0, _SECONDS, shown)
    never = 0 if observed else _NEVER
    draw.reading(pen, _NOW, recall(since, known), 2, 0, never)
    draw.reading(pen, _STABLE, known, 1, _UNIT, never)
    draw.reading(pen, _HARD, state["difficulty"][k], 1, 0, never)
    draw.reading(pen, _NEXT, interval(known), 0, _UNIT, never)
    draw.reading(pen, _COUNT, np.sum(state["reviews"]), 0)


PRESETS = {
    "Mock question": Preset(
        {},
        "Answer aloud while the thin bar below the card shrinks: a minute. Then click Reveal, "
        "compare, and rate how well you knew it. The curve jumps at once to its new course, a "
        "number below it says after how many days you are asked again, and the next question "
        "starts its own minute.",
    ),
    "Days pass": Preset(
        {"speed": 1.0},
        "A second is a day. Four answers that were rated some days ago: the spot "
        "slides down the curve. Below the dashed line it turns orange, and the question is asked "
        "again. Reveal and rate it: the curve starts again, and falls more slowly.",
    ),
    "Asked when due": Preset(
        {"reviewer": "when due", "speed": 5.0},
        "Each review comes when nine in ten would still know it. The waits grow. How many reviews "
        "are there after sixty days?",
    ),
    "Crammed": Preset(
        {"reviewer": "every day", "speed": 5.0},
        "A review every day. The chance stays near one, and each review slows the forgetting far "
        "less.",
    ),
    "Always forgotten": Preset(
        {"reviewer": "when due", "rating": "again", "speed": 5.0},
        "Rated 'again' each time: difficulty runs to its limit, and the wait never leaves a day.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "time left to answer": "Seconds of the minute in which you answer aloud.",
    "chance now": "Predicted probability that you recall this card now.",
    "down to 90 % after": "Days from the last review until the chance of recall is 90 %.",
    "difficulty (1 to 10)": "The scheduler's estimate; at 10, the days grow most slowly.",
    "asked again after": "Days from the last review to the next one: whole days.",
    "reviews of all four": "Reviews of all four cards so far.",
}

MODEL = Model(
    TITLE,
    PAPER,
    CONTROLS,
    STATE,
    PRESETS,
    initial,
    advance,
    frame,
    drag,
    grab=grab,
    press=press,
    live_drag=True,
    readouts=READOUTS,
    upright=False,
)
