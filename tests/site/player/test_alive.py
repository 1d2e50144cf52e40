"""Nothing on a panel is dead: whatever can be played, moved, chosen, pressed or dragged changes it.

What changes is pixels of the canvas or the numbers below it. A run is a function of its controls
and of the time that has passed, so two runs with the same clicks on Step show the same pictures: a
control that does not change the picture at once is compared with the run in which it was not moved.
Every wait is for a condition, with a backstop of two minutes. `make prove` tries all panels, every
run one of each kind.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from course.simulations import declaration
from tests.conftest import chromium

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>A page</title>
<meta name="viewport" content="width=device-width">
<body style="margin:1rem;font:16px/1.5 sans-serif"><div style="max-width:46em">
<div class="course-live" data-simulation="{name}"></div></div>
<div style="height:3000px"></div>
<script src="live.js"></script><script src="{name}.js"></script></body></html>"""

# The steps of simulated time after which two runs are compared, one after the other [pictures].
LATER = (0, 1, 4, 20, 100, 400)

# What the tests use of a page. A picture is painted in the animation frame after an action, so the
# next frame shows what an action did; a preset may have to be unpacked first.
TOOLS = """
const panel = document.querySelector('.course-live');
const canvas = panel.querySelector('canvas');
const [play, step, reset] = panel.querySelectorAll('.buttons button');
const presets = panel.querySelector('.side select:not([data-control])');
const controls = [...panel.querySelectorAll('[data-control]')];
const frame = () => new Promise(requestAnimationFrame);
const until = async (condition, what) => {
  const end = performance.now() + 120000;
  while (!(await condition())) {
    if (performance.now() > end) throw new Error(`${what}: nothing came`);
    await frame();
  }
};

// What somebody sees: a hash of the pixels (FNV-1a, by words), and the numbers below them. A
// picture that is computed in portions is waited for.
const busy = () => panel.courseLive.remaining?.() > 0;
const shown = async () => {
  do await frame();
  while (busy());
  const context = canvas.getContext('2d');
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  let hash = 2166136261;
  for (const word of new Uint32Array(data.buffer)) hash = Math.imul(hash ^ word, 16777619);
  return `${hash >>> 0} ${panel.querySelector('.course-numbers').textContent}`;
};
const choose = async index => {
  const before = canvas.dataset.frame;
  presets.selectedIndex = index;
  presets.dispatchEvent(new Event('change'));
  await until(() => canvas.dataset.frame !== before, 'a preset');
};
// The pictures of the run that stands there, one for each number of steps in `later`.
const run = async later => {
  const pictures = [];
  let passed = 0;
  for (const steps of later) {
    for (; passed < steps; passed += 1) step.click();
    pictures.push(await shown());
  }
  return pictures;
};
// The values of a control that are tried: both ends of a slider, both positions of a switch, each
// option of a menu. Those that it has already say nothing.
const values = control => {
  if (control.type === 'range') return [control.min, control.max];
  if (control.type === 'checkbox') return [false, true];
  return [...control.options].map(option => option.value);
};
const get = control => (control.type === 'checkbox' ? control.checked : control.value);
const put = (control, value) => {
  if (control.type === 'checkbox') control.checked = value;
  else control.value = value;
  control.dispatchEvent(new Event(control.type === 'range' ? 'input' : 'change'));
};
"""
PLAYS = """async () => {
  const first = await shown();
  play.click();
  await until(async () => (await shown()) !== first, 'Play');
  play.click();
  const later = await shown();
  const pauses = (await shown()) === later;
  reset.click();
  return [pauses, (await shown()) === first];
}"""
# Which presets look alike, and the controls with a value that changes nothing in any preset.
MOVES = """async later => {
  const [plain, alike, dead] = [[], [], {}];
  const names = [...presets.options].map(option => option.text);
  for (const index of names.keys()) {
    await choose(index);
    plain.push(await run(later));
    for (let k = 0; k < index; k += 1)
      if (plain[k].every((picture, n) => picture === plain[index][n]))
        alike.push([names[k], names[index]]);
  }
  // Whether the value changes something in a preset; nothing where the control has it already.
  const changes = async (control, value, index) => {
    for (let n = 0; n < later.length; n += 1) {
      await choose(index);
      if (get(control) === value) return null;
      put(control, value);
      if ((await run(later.slice(0, n + 1))).at(-1) !== plain[index][n]) return true;
    }
    return false;
  };
  for (const control of controls) {
    const [without, all] = [[], values(control)];
    let moves = false;
    for (const value of all) {
      let [tried, alive] = [false, false];
      for (let index = 0; index < names.length && !alive; index += 1) {
        const changed = await changes(control, value, index);
        tried ||= changed !== null;
        alive = changed === true;
      }
      moves ||= alive;
      if (tried && !alive) without.push(value);
    }
    // Each option of a menu has to do something, of a slider and a switch one end is enough.
    const menu = control.type === 'select-one';
    if (!moves || (menu && without.length)) dead[control.dataset.control] = without;
  }
  return [alike, dead];
}"""
# Points of the canvas where a drag changes the picture, one for each set of controls that it
# changes [CSS pixels from its corner], and how far it goes. The run is put back after each.
HANDLES = """async ([columns, rows, right, up]) => {
  const { declaration } = window.courseSimulations[panel.dataset.simulation];
  const [xmin, xmax, ymin, ymax] = declaration.paper.window;
  const [width, height] = [xmax - xmin, ymax - ymin];
  const handles = new Map();
  await choose(0);
  const live = panel.courseLive;
  if (!live.records || !declaration.functions.includes('drag')) return [];
  live.complete(Infinity);
  const before = live.records();
  const words = record => new BigUint64Array(record.buffer);
  const picture = () => live.picture().slice();
  const plain = picture();
  for (let k = 0; k < columns * rows; k += 1) {
    const [u, v] = [((k % columns) + 0.5) / columns, (Math.floor(k / columns) + 0.5) / rows];
    const [x, y] = [xmin + u * width, ymax - v * height];
    live.grab(x, y);
    live.drag(x, y);
    live.complete(Infinity);
    live.drag(x + right * width, y + up * height);
    live.complete(Infinity);
    const old = words(before[0]);
    const moved = [...words(live.records()[0]).entries()].filter(([n, word]) => word !== old[n]);
    const key = moved.map(([n]) => n).join();
    if (!handles.has(key)) {
      const now = picture();
      if (now.length !== plain.length || now.some((number, n) => !Object.is(number, plain[n])))
        handles.set(key, [u * canvas.clientWidth, v * canvas.clientHeight]);
    }
    live.take(before);
  }
  await choose(0);
  return [...handles.values()];
}"""
# Which keys change the picture in some preset, one after the other and back.
KEYS = """async keys => {
  const alive = new Set();
  for (const index of [...presets.options].keys()) {
    await choose(index);
    for (const key of [...keys, ...keys.toReversed()]) {
      const before = await shown();
      canvas.dispatchEvent(new KeyboardEvent('keydown', { key, cancelable: true }));
      if ((await shown()) !== before) alive.add(key);
    }
    if (alive.size === keys.length) break;
  }
  return keys.filter(key => alive.has(key));
}"""
# Whether a click on each number below the picture says what it means.
MEANINGS = """() => {
  const note = panel.querySelector('.course-meaning');
  return [...panel.querySelectorAll('.course-numbers > div')].map(cell => {
    cell.click();
    return note.textContent.startsWith(`${cell.children[0].textContent}: `);
  });
}"""
STARTS = "async () => { await choose(0); window.start = await shown(); }"
MOVED = "() => until(async () => (await shown()) !== window.start, 'the pointer')"

# Options that change nothing by themselves: which thing the keys move, where that is the goal, or
# an obstacle that no preset has; a click makes it.
QUIET = {"planning.growing": {"piece": ["1", "9", "10"]}}
# One of each kind: it begins anew after a drag; it is seen from all sides; values are dragged, and
# keys move them; something is chosen by a click; nothing is dragged; it is recorded.
SAMPLE = {
    "rigid_body.spring",
    "contact.friction_cone",
    "learning.clipped_objective",
    "learning.gae_weights",
    "pipeline",
}
# A grid of points of the canvas where drags begin, and how far they go, in shares of the canvas.
GRID = (24, 15, 0.05, 0.04)


def sampled(names: Iterable[str]) -> list[Any]:
    """Return the parameters of a test: in every run the sample of these simulations."""
    return [n if n in SAMPLE else pytest.param(n, marks=pytest.mark.prove) for n in names]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    flags = ["--no-sandbox", "--disable-gpu", "--disable-quic"]
    with sync_playwright() as playwright:
        made = playwright.chromium.launch(executable_path=chromium(), args=flags)
        yield made
        made.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("panels")
    (folder / "live.js").write_text(declaration.script(), encoding="utf-8")
    return folder


@contextmanager
def opened(browser: Any, folder: Path, name: str, **options: Any) -> Iterator[Any]:
    """Open the panel of a simulation in a page of its own; nothing may complain there."""
    address = folder / f"{name}.html"
    if not address.exists():
        address.write_text(PAGE.format(name=name), encoding="utf-8")
        (folder / f"{name}.js").write_text(declaration.bundle(name), encoding="utf-8")
        if not declaration.is_live(name):
            (folder / f"{name}.film.js").write_text(declaration.film(name), encoding="utf-8")
    context, wrong = browser.new_context(**options), list[str]()
    page = context.new_page()
    page.set_default_timeout(120_000)
    # A warning that the tests read many pixels is not the page's.
    page.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.goto(address.as_uri())
    page.wait_for_selector("[data-ready] canvas[data-frame]")
    page.add_script_tag(content=TOOLS)
    yield page
    context.close()
    assert wrong == []


@pytest.mark.parametrize("name", sampled(declaration.names()))
def test_nothing_on_a_panel_is_dead(browser: Any, folder: Path, name: str) -> None:
    declared = declaration.declaration(name)
    live = not declared["recorded"]
    with opened(browser, folder, name, viewport={"width": 1024, "height": 800}) as page:
        pauses, resets = page.evaluate(PLAYS)
        assert pauses and resets
        alike, dead = page.evaluate(MOVES, list(LATER))
        assert alike == [], "presets that show the same"
        assert dead == QUIET.get(name, {}), "controls that do nothing"
        assert all(page.evaluate(MEANINGS)), "numbers without a meaning"
        handles = (
            page.evaluate(HANDLES, list(GRID)) if live and "drag" in declared["functions"] else []
        )
        assert bool(handles) == (live and "drag" in declared["functions"])
        box = page.locator("canvas").bounding_box()
        for x, y in handles:
            page.evaluate(STARTS)
            page.mouse.move(box["x"] + x, box["y"] + y)
            page.mouse.down()
            x, y = x + GRID[2] * box["width"], y - GRID[3] * box["height"]
            page.mouse.move(box["x"] + x, box["y"] + y)
            page.evaluate(MOVED)
            page.mouse.up()
        keys = declared["keys"] if live else []
        assert bool(page.evaluate(KEYS, keys)) == bool(keys)


def test_what_is_dead_is_reported(browser: Any, folder: Path) -> None:
    """Of a copy whose slider, switch, preset and handle do nothing."""
    name = "contact.penalty_spring"
    with opened(browser, folder, name, viewport={"width": 1024, "height": 800}) as page:
        page.evaluate("""() => {
          const run = panel.courseLive;
          const [set, choose] = [run.set, run.choose];
          run.set = (input, value) => ['height', 'pull'].includes(input.name) || set(input, value);
          run.choose = preset => choose(preset.name === presets.options[1].text
            ? courseSimulations[panel.dataset.simulation].declaration.presets[0] : preset);
          run.drag = () => {};
        }""")
        names = page.locator(".side select").first.locator("option").all_inner_texts()
        alike, dead = page.evaluate(MOVES, list(LATER))
        assert alike == [names[:2]] and dead.keys() == {"height", "pull"}
        assert page.evaluate(HANDLES, list(GRID)) == []


def _scrolls(name: str) -> bool:
    declared = declaration.declaration(name)
    return (
        bool(declared["recorded"]) or "drag" not in declared["functions"] or not declared["upright"]
    )


@pytest.mark.prove
@pytest.mark.parametrize("name", sampled(filter(_scrolls, declaration.names())))
def test_a_finger_that_begins_on_a_picture_scrolls_a_phone(
    browser: Any, folder: Path, name: str
) -> None:
    phone: dict[str, Any] = {"viewport": {"width": 390, "height": 844}}
    phone |= {"has_touch": True, "is_mobile": True}
    with opened(browser, folder, name, **phone) as page:
        before = page.evaluate("shown()")
        box = page.locator("canvas").bounding_box()
        session = page.context.new_cdp_session(page)
        # From the middle of the picture up: fingers begin anywhere.
        x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.6 * box["height"]
        for k in range(13):
            kind = "touchMove" if k else "touchStart"
            points = [{"x": x, "y": y - 15.0 * k}]
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        page.wait_for_function("() => window.scrollY > 50")
        assert page.evaluate("shown()") == before, "nothing was dragged"
