"""What a page of the site remembers of its cards, and its pictures: page.js in Chromium.

A page is made of the markup that `course.derivations.markup` promises; nothing else of the site is
there.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from course.cards import draws
from course.derivations import markup
from course.site import build
from tests.conftest import chromium

pytestmark = [pytest.mark.browser, pytest.mark.slow]

SCRIPT = build.HERE / "page.js"
STYLE = build.HERE / "course.css"
DOT = (
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR4nGNg"
    "YGBgAAAABQABh6FO1AAAAABJRU5ErkJggg=="
)


def card(name: str) -> str:
    """A card with a wrong and a right answer and its explanation, as HTML."""
    answers = (
        markup.Answer("It falls", False, "No, it does not."),
        markup.Answer("It stays", True, "It does."),
    )
    return markup.card(name, "Predict.", "What does it do?", answers, "Because it is held.")


PAGE = f"""<!doctype html><html lang="en"><meta charset="utf-8"><title>A page</title>
<link rel="stylesheet" href="course.css"><body><article><h1>A chapter</h1>
{card("contact.mug")} {card("contact.tray")}
<p><img src="{DOT}" alt="a chart" style="width:200px;height:100px"></p>
<div class="course-live"><img src="{DOT}" alt="a simulation"></div></article>
<script src="page.js" defer></script></body></html>"""
HOME = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Home</title>
<body><article><h1>Home</h1><div class="course-scores"><ul>
<li data-cards="contact.mug contact.tray contact.other"><a href="page.html">2</a>
<span class="score"></span></li>
<li data-cards="control.pid"><a href="x.html">6</a> <span class="score"></span></li>
</ul></div></article><script src="page.js" defer></script></body></html>"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    flags = ["--no-sandbox", "--disable-gpu", "--disable-quic"]
    with sync_playwright() as playwright:
        made = playwright.chromium.launch(executable_path=chromium(), args=flags)
        yield made
        made.close()


@pytest.fixture
def page(browser: Any, tmp_path: Path) -> Iterator[Any]:
    for file in (SCRIPT, STYLE):
        (tmp_path / file.name).write_text(file.read_text("utf-8"), "utf-8")
    (tmp_path / "page.html").write_text(PAGE, "utf-8")
    (tmp_path / "index.html").write_text(HOME, "utf-8")
    context = browser.new_context(viewport={"width": 390, "height": 844})
    made = context.new_page()
    wrong: list[str] = []
    made.on("console", lambda message: wrong.append(message.text))
    made.on("pageerror", lambda error: wrong.append(str(error)))
    made.home = (tmp_path / "index.html").as_uri()
    made.goto((tmp_path / "page.html").as_uri())
    yield made
    context.close()
    assert wrong == []


def answer(page: Any, name: str, label: str) -> None:
    page.locator(f'[data-card="{name}"] summary', has_text=label).click()


def result_of(page: Any, name: str) -> str:
    line = page.locator(f'[data-card="{name}"] .card-answered')
    return line.inner_text() if line.count() else ""


def test_the_first_answer_counts(page: Any) -> None:
    score = page.locator(".course-score span")
    assert score.inner_text() == "Your answers: none of 2 cards answered."
    assert not page.locator(".course-score button").is_visible()
    assert not page.locator("[data-card='contact.mug'] .why").evaluate("e => e.open")
    answer(page, "contact.mug", "It falls")
    page.wait_for_selector(".card-answered")
    assert result_of(page, "contact.mug") == "Not right: your first answer was “It falls”."
    assert page.locator("[data-card='contact.mug'] .why").evaluate("e => e.open"), "it explains"
    answer(page, "contact.mug", "It stays")  # can be read, and changes nothing
    page.wait_for_timeout(100)
    assert result_of(page, "contact.mug") == "Not right: your first answer was “It falls”."
    assert score.inner_text() == "Your answers: 0 right of 1 answered, 2 cards."
    answer(page, "contact.tray", "It stays")
    page.wait_for_function("() => document.querySelectorAll('.card-answered').length === 2")
    assert result_of(page, "contact.tray") == "Right: your first answer was “It stays”."
    assert score.inner_text() == "Your answers: 1 right of 2 answered, 2 cards."


def test_answers_are_remembered_and_counted_at_home_until_they_are_forgotten(page: Any) -> None:
    answer(page, "contact.tray", "It stays")
    page.wait_for_selector(".card-answered")
    page.reload()
    assert result_of(page, "contact.tray") == "Right: your first answer was “It stays”."
    assert page.locator(".card .chosen summary").inner_text() == "It stays"
    assert result_of(page, "contact.mug") == ""
    address = page.url
    page.goto(page.home)
    scores = page.locator(".score").all_inner_texts()
    assert scores == ["1 right of 1 answered, 3 cards", "none of 1 cards answered"]
    total = page.locator(".course-scores > p span")
    assert total.inner_text() == "All chapters: 1 right of 1 answered, 4 cards."
    page.get_by_role("button", name="Forget all my answers").click()
    assert total.inner_text() == "All chapters: none of 4 cards answered."
    page.goto(address)
    assert result_of(page, "contact.tray") == ""
    answer(page, "contact.tray", "It falls")
    page.wait_for_selector(".card-answered")
    assert result_of(page, "contact.tray").startswith("Not right")
    page.get_by_role("button", name="Forget my answers to the cards of this page").click()
    assert result_of(page, "contact.tray") == ""
    assert page.locator("details[open]").count() == 0


@pytest.mark.prove
@pytest.mark.parametrize("stored", ["not json", "[]", '{"contact.mug": 3}'])
def test_what_others_have_stored_does_no_harm(page: Any, stored: str) -> None:
    page.evaluate("text => localStorage.setItem('course.cards', text)", stored)
    page.reload()
    answer(page, "contact.tray", "It stays")
    page.wait_for_selector("[data-card='contact.tray'] .card-answered")
    assert result_of(page, "contact.tray") == "Right: your first answer was “It stays”."
    assert result_of(page, "contact.mug") == ""


# --- The checkpoint -------------------------------------------------------------------------------


@pytest.fixture
def checkpoint(page: Any, tmp_path: Path) -> Any:
    """A page with the checkpoint of a chapter, as the site writes it; its Markdown is left raw."""
    style = '<link rel="stylesheet" href="course.css"><script src="page.js" defer></script>'
    text = f'<!doctype html><meta charset="utf-8"><article>{draws.offered("contact")}</article>'
    (tmp_path / "gate.html").write_text(f"{text}{style}", "utf-8")
    page.goto((tmp_path / "gate.html").as_uri())
    return page


def questions(page: Any) -> list[str]:
    shown = page.locator(".checkpoint-question:visible")
    return [str(one.get_attribute("data-key")) for one in shown.all()]


def give(page: Any, key: str, right: bool = True) -> None:
    question = page.locator(f'[data-key="{key}"]')
    if question.get_attribute("data-part") == "estimate":
        question.locator("input").fill(question.get_attribute("data-value") if right else "-1")
        question.get_by_role("button", name="Check").click()
    else:
        mark = "yes" if right else "no"
        question.locator(f'.answer[data-right="{mark}"] > summary').first.click()
    page.wait_for_selector(f'[data-key="{key}"] .card-answered')


def status(page: Any) -> str:
    return str(page.locator(".course-checkpoint .course-score span").inner_text())


@pytest.mark.prove
def test_a_seed_draws_the_same_questions_as_in_a_notebook(checkpoint: Any) -> None:
    for seed in range(1, 31):
        assert questions(checkpoint) == [q.key for q in draws.draw("contact", seed)]
        assert status(checkpoint).startswith(f"Draw {seed}: 0 right of 0 answered, 5 questions.")
        checkpoint.get_by_role("button", name="New questions").click()


def test_a_checkpoint_is_passed_when_all_are_right_and_stays_passed(checkpoint: Any) -> None:
    first = questions(checkpoint)
    give(checkpoint, first[0], right=False)
    why = checkpoint.locator(f'[data-key="{first[0]}"] > .why')
    assert why.evaluate("e => e.open"), "it explains"
    for key in first[1:]:
        give(checkpoint, key)
    ended = "Draw 1: 4 right of 5 answered, 5 questions. Checkpoint open."
    assert status(checkpoint) == ended
    checkpoint.locator(f'[data-key="{first[0]}"] .answer[data-right="yes"] > summary').click()
    checkpoint.wait_for_timeout(100)
    assert status(checkpoint) == ended, "the first answer counts"
    checkpoint.reload()
    assert status(checkpoint) == ended and questions(checkpoint) == first
    checkpoint.get_by_role("button", name="New questions").click()
    assert checkpoint.locator("details[open]").count() == 0
    assert checkpoint.locator(".card-answered").count() == 0
    for key in questions(checkpoint):
        give(checkpoint, key)
    assert status(checkpoint) == "Draw 2: 5 right of 5 answered, 5 questions. Checkpoint passed."
    checkpoint.get_by_role("button", name="New questions").click()
    checkpoint.reload()
    assert status(checkpoint) == "Draw 3: 0 right of 0 answered, 5 questions. Checkpoint passed."


@pytest.mark.prove
def test_an_estimate_is_right_within_its_factor_and_has_to_be_a_number(checkpoint: Any) -> None:
    (key,) = [key for key in questions(checkpoint) if key.startswith("estimate.")]
    question = checkpoint.locator(f'[data-key="{key}"]')
    value = float(question.get_attribute("data-value"))
    factor = float(question.get_attribute("data-factor"))
    for text in ("", "much", "1e999"):
        question.locator("input").fill(text)
        question.get_by_role("button", name="Check").click()
        assert question.locator(".card-answered").count() == 0
    for share, verdict in (
        (0.99 * factor, "Right"),
        (1.01 * factor, "Not right"),
        (1.01 / factor, "Right"),
        (0.99 / factor, "Not right"),
    ):
        question.locator("input").fill(repr(share * value))
        question.get_by_role("button", name="Check").click()
        assert result_at(checkpoint, key).startswith(f"{verdict}: your first answer was")
        checkpoint.evaluate("localStorage.removeItem('course.checkpoint')")
        checkpoint.reload()


def result_at(page: Any, key: str) -> str:
    page.wait_for_selector(f'[data-key="{key}"] .card-answered')
    return str(page.locator(f'[data-key="{key}"] .card-answered').inner_text())


@pytest.mark.parametrize(
    "stored",
    [
        "not json",
        "[]",
        "3",
        "null",
        '{"contact": 3}',
        '{"contact": {"seed": -1, "answers": [1]}}',
        '{"contact": {"seed": 1, "answers": {"x": 3}, "passed": "yes"}}',
    ],
)
@pytest.mark.prove
def test_a_damaged_checkpoint_begins_with_the_first_draw(checkpoint: Any, stored: str) -> None:
    checkpoint.evaluate("text => localStorage.setItem('course.checkpoint', text)", stored)
    checkpoint.reload()
    assert status(checkpoint) == "Draw 1: 0 right of 0 answered, 5 questions. Checkpoint open."
    give(checkpoint, questions(checkpoint)[-1])
    assert status(checkpoint).startswith("Draw 1: 1 right of 1 answered")


def test_answers_to_cards_and_checkpoints_do_not_mix(checkpoint: Any) -> None:
    cards = '{"contact.mug": ["It falls", false]}'
    checkpoint.evaluate("text => localStorage.setItem('course.cards', text)", cards)
    checkpoint.reload()
    give(checkpoint, questions(checkpoint)[0])
    assert checkpoint.evaluate("localStorage.getItem('course.cards')") == cards
    stored = checkpoint.evaluate("JSON.parse(localStorage.getItem('course.checkpoint'))")
    assert list(stored) == ["contact"] and stored["contact"]["seed"] == 1


def claim(number: int) -> str:
    verdict = ("holds", "false", "holds only if")[number % 3]
    return f"""<div class="course-claim" id="c{number}" data-chapter="{number // 30}"
data-verdict="{verdict}"><p>Claim {number}</p>
<div class="course-verdict">It is {verdict}.</div></div>"""


CLAIMS = "".join(
    f"<section id='s{k}'><h2>{k} · Chapter</h2>{''.join(map(claim, range(30 * k, 30 * k + 30)))}"
    "</section>"
    for k in range(2)
)


@pytest.fixture
def claims(page: Any, tmp_path: Path) -> Any:
    text = f"<!doctype html><article><section><h1>All</h1>{CLAIMS}</section></article>"
    style = '<link rel="stylesheet" href="course.css"><script src="page.js" defer></script>'
    (tmp_path / "claims.html").write_text(f'<meta charset="utf-8">{text}{style}', "utf-8")
    page.goto((tmp_path / "claims.html").as_uri())
    return page


def visible(page: Any) -> list[str]:
    shown = page.locator(".course-claim:visible > p:first-child")
    return [text.removeprefix("Claim ") for text in shown.all_inner_texts()]


def test_claims_come_in_pages_by_chapter_and_verdict(claims: Any) -> None:
    assert visible(claims) == [str(k) for k in range(20)]
    above, below = claims.get_by_role("button", name="Next").all()
    below.click()
    assert visible(claims) == [str(k) for k in range(20, 40)]
    assert claims.locator(".course-browse").first.bounding_box()["y"] == pytest.approx(0, abs=20)
    above.click()
    assert visible(claims) == [str(k) for k in range(40, 60)]
    assert above.is_disabled() and below.is_disabled()
    claims.get_by_label("Chapter").select_option("1")
    claims.get_by_label("Verdict", exact=True).select_option("false")
    assert visible(claims) == [str(k) for k in range(30, 60) if k % 3 == 1]
    assert claims.locator("h2:visible").all_inner_texts() == ["1 · Chapter"]
    assert claims.get_by_role("status").inner_text() == "1 to 10 of 10 claims"
    assert above.is_disabled() and not below.is_visible(), "one page has no second pair of buttons"
    claims.evaluate("location.hash = '#c59'")
    claims.wait_for_function("() => !document.querySelector('#c59').hidden")
    assert "59" in visible(claims) and "0" not in visible(claims)


@pytest.mark.prove
def test_the_verdict_is_hidden_until_it_is_guessed(claims: Any) -> None:
    assert claims.locator(".course-verdict:visible").count() == 20
    claims.get_by_label("hide the verdict").check()
    assert claims.locator(".course-verdict:visible").count() == 0
    claims.locator("#c1").get_by_role("button", name="False").click()
    assert claims.locator(".course-verdict:visible").all_inner_texts() == ["It is false."]


@pytest.mark.prove
def test_a_quiz_asks_ten_claims_and_counts(claims: Any) -> None:
    claims.get_by_label("Chapter").select_option("0")
    claims.get_by_role("button", name="Quiz me").click()
    shown = visible(claims)
    assert len(shown) == 10 == len(set(shown)) and all(int(k) < 30 for k in shown)
    right = 0
    for name in shown:
        place = claims.locator(f"#c{name}")
        place.get_by_role("button", name="True", exact=True).click()
        right += int(name) % 3 == 0
    words = f"{right} right of 10 answered, 10 claims"
    assert claims.get_by_role("status").inner_text() == words
    claims.get_by_role("button", name="End the quiz").click()
    assert len(visible(claims)) == 20


@pytest.mark.prove
def test_a_picture_is_enlarged_and_closed_with_the_keyboard(page: Any) -> None:
    dialog, chart = page.locator("dialog"), page.locator("article a.course-enlarge")
    assert chart.count() == 1, "a simulation is not enlarged"
    assert not dialog.is_visible()
    chart.focus()
    page.keyboard.press("Enter")
    assert dialog.is_visible() and dialog.locator("img").get_attribute("alt") == "a chart"
    wide = dialog.locator("img").evaluate("e => e.getBoundingClientRect().width")
    assert wide >= 640, "as wide as its letters want, on a phone too"
    assert page.evaluate("document.activeElement.textContent") == "Close"
    page.keyboard.press("Escape")
    assert not dialog.is_visible()
    assert page.evaluate("document.activeElement.className") == "course-enlarge"
    chart.click()
    dialog.get_by_role("button", name="Close").click()
    assert not dialog.is_visible()
