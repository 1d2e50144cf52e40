// A simulation in a page without a kernel, from the same declaration as the notebook's panel
// (course/simulations/declaration.py): its model compiled for the browser, or pictures recorded
// beforehand, and the panel around them.

import { view, written } from "./canvas.js";

const STEP = 1 / 25; // what the button Step lets pass, and the time between two recorded pictures [s]
// Whatever a picture had to wait for, time goes on from where it was, it does not catch up [s].
const LONGEST = 0.1;
const [STILL, PLAYING] = [700, 5000]; // between two readings of the numbers aloud [ms]
// What takes long is done in portions: so long before each picture, until none is left [ms].
const BUDGET = 12;
const [OK, NONE] = [0, -2]; // what a function compiled by Numba says when all went well

const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

// What the compiled code asks of a C library; the rest has the same name in Math.
const HOST = { fabs: Math.abs, fmod: (a, b) => a % b, exp2: (x) => 2 ** x };

// The value that an input may set: within its limits, and whole where it is; otherwise nothing.
export function allowed(input, value) {
  const number = Number(value);
  if (value === "" || value === null || !Number.isFinite(number)) return null;
  if (input.choices.length) return number in input.choices ? number : null;
  const within = Math.min(Math.max(number, input.low), input.high);
  return input.kind === "f" ? within : Math.round(within);
}

const passing = (seconds) => {
  if (!(seconds >= 0)) throw new RangeError(`seconds must be a non-negative number, got ${seconds}`);
  return Math.min(seconds, LONGEST);
};

// One run of a compiled model: what `Experiment` is in Python. Its arrays are made once, behind what
// the module keeps for itself.
export async function compiled(told, code) {
  const module = await WebAssembly.compile(code);
  const host = {};
  for (const { name } of WebAssembly.Module.imports(module)) host[name] = HOST[name] ?? Math[name];
  const { exports } = await WebAssembly.instantiate(module, { env: host });
  const { memory } = exports;

  // A bump allocator: each array begins where the previous one ends, on a multiple of 16 bytes.
  let end = exports.__heap_base.value;
  const room = (bytes) => {
    const here = (end + 15) & -16;
    end = here + bytes;
    return here;
  };
  const [result, fault] = [room(64), room(16)];
  const [controls, state] = [room(told.controls.size), room(told.state.size)];
  const [pen, items] = [room(8 * told.pen.size), BigInt(told.pen.size)];
  const missing = end - memory.buffer.byteLength;
  if (missing > 0) memory.grow(Math.ceil(missing / 65536));

  let floats, wholes, words, numbers, bytes;
  const look = () => {
    // Growing the memory detaches its ArrayBuffer, and every view of the old buffer becomes empty.
    if (floats?.buffer === memory.buffer) return;
    floats = new Float64Array(memory.buffer);
    wholes = new BigInt64Array(memory.buffer);
    words = new BigUint64Array(memory.buffer);
    numbers = new Int32Array(memory.buffer);
    bytes = new Uint8Array(memory.buffer);
  };
  const call = (name, ...given) => {
    const status = exports[name](result, fault, ...given);
    look();
    if (status === OK || status === NONE) return;
    // An exception is told by where its words are and how many bytes they have.
    const [data, size] = status > 0 ? numbers.subarray(numbers[fault / 4] / 4) : [0, 0];
    const said = new TextDecoder().decode(bytes.subarray(data, data + size));
    throw new Error(said || `${name} ended with ${status}`);
  };
  // The declaration stores records run-length encoded: a count and a word of 64 bits.
  const fill = (at, runs) => {
    let here = at / 8;
    for (const [count, word] of runs) words.fill(BigInt(word), here, (here += count));
  };
  const place = (input) => (controls + input.offset) / 8;
  const get = (input) => Number((input.kind === "f" ? floats : wholes)[place(input)]);
  const picture = new Float64Array(told.pen.size);
  const shown = told.pen.header.length;

  const start = () => {
    fill(state, told.state.words);
    call("initial", controls, state);
  };
  const acts = (name, ...given) => {
    if (!told.functions.includes(name)) return false;
    call(name, controls, state, ...given);
    return true;
  };
  // How many portions of what takes long are left.
  const { remaining: counter } = told.state;
  const remaining = () => (counter === undefined ? 0 : Number(wholes[(state + counter) / 8]));
  const moved = (name, ...given) => {
    if (acts(name, ...given) && !told.live_drag) start();
  };
  look();
  return {
    start,
    get,
    set(input, value) {
      const good = allowed(input, value);
      if (good === null || good === get(input)) return;
      if (input.kind === "f") floats[place(input)] = good;
      else wholes[place(input)] = BigInt(good);
      if (!input.live) start();
    },
    choose(preset) {
      fill(controls, preset.words);
      start();
    },
    advance: (seconds) => call("advance", state, controls, passing(seconds)),
    remaining,
    // Do portions, one at least, until so much time has passed or none is left.
    complete(milliseconds) {
      const end = performance.now() + milliseconds;
      while (remaining() > 0) {
        call("complete", controls, state);
        if (performance.now() >= end) break;
      }
    },
    grab: (x, y) => void acts("grab", x, y),
    drag: (x, y) => moved("drag", x, y),
    press: (key) => moved("press", BigInt(key)),
    picture() {
      floats.set(told.pen.header, pen / 8);
      // Numba passes a 1-D array as seven values: meminfo, parent, items, item size, data, shape and
      // stride. The pen counts what it has written in its first number, the header included.
      call("frame", 0, 0, items, 8n, pen, items, 8n, state, controls);
      const count = floats[pen / 8] - shown;
      const from = pen / 8 + shown;
      picture.set(floats.subarray(from, from + count));
      return picture.subarray(0, count);
    },
    // Both records as they are; and go on from such.
    records: () => [
      bytes.slice(controls, controls + told.controls.size),
      bytes.slice(state, state + told.state.size),
    ],
    take(records) {
      bytes.set(records[0], controls);
      bytes.set(records[1], state);
    },
    // What the module has taken [bytes].
    memory: () => memory.buffer.byteLength,
  };
}

// The same for pictures that were computed beforehand: time passes, and the last one stays. What
// there is of each preset is told at `_recorded` in declaration.py.
export async function recorded(told, presets) {
  const [GRID, GAP, EXACT] = [512, -(2 ** 31), 1 - 2 ** 31];
  let [film, time] = [[], 0];
  const start = () => void (time = 0);
  return {
    start,
    // Unpack the film of a preset, before it is chosen.
    async load(preset) {
      const { sizes, data } = presets[preset.name];
      const stream = new Blob([bytesOf(data)]).stream();
      const packed = stream.pipeThrough(new DecompressionStream("gzip"));
      const view = new DataView(await new Response(packed).arrayBuffer());
      let [at, before, picture] = [0, [], null];
      film = sizes.map((size) => {
        if (size === 0) return picture;
        // The four bytes of all numbers lie in four planes, which gzip packs better than words. Each
        // number is the difference from the previous picture.
        const steps = new Int32Array(size);
        for (let k = 0; k < size; k += 1) {
          let change = 0;
          for (let byte = 0; byte < 4; byte += 1)
            change |= view.getUint8(at + byte * size + k) << (8 * byte);
          steps[k] = change + (before[k] ?? 0);
        }
        at += 4 * size;
        picture = Float64Array.from(steps, (step) => {
          if (step === EXACT) return view.getFloat64((at += 8) - 8, true);
          return step === GAP ? NaN : step / GRID;
        });
        before = steps;
        return picture;
      });
    },
    choose: start,
    advance: (seconds) => void (time += passing(seconds)),
    // The small addend keeps n times STEP in picture n when its sum was rounded down.
    picture: () => film[Math.min(Math.floor(time / STEP + 1e-6), film.length - 1)],
  };
}

const STYLE = `
.course-live{--line:var(--color-background-border,#8884);--quiet:var(--color-foreground-muted,#767676);
  --accent:var(--color-brand-primary,#0a5fb4);margin:1rem 0;container-type:inline-size}
.course-live>img{max-width:100%;height:auto}
.course-live .title{font-weight:bold;margin:0 0 .4rem;display:flex;gap:.6rem;align-items:baseline}
.course-live .title small{font-weight:normal;color:var(--quiet);border:1px solid var(--line);
  border-radius:1em;padding:0 .6em}
.course-live .parts{display:flex;flex-flow:row wrap;gap:.8rem 1.2rem;align-items:flex-start}
.course-live .picture{flex:3 1 min(400px,100%);min-width:0}
.course-live .picture img{display:block;width:100%;height:auto}
.course-live .side{flex:1 1 min(230px,100%);min-width:0;font-size:.85rem;line-height:1.35}
.course-live .buttons{display:flex;gap:.4rem}
.course-live button,.course-live select{font:inherit;color:inherit;min-height:2.2em;cursor:pointer;
  background:var(--color-background-secondary,transparent);border:1px solid var(--line);
  border-radius:4px;padding:.2em .6em}
.course-live button{flex:1}
.course-live button.play{border-color:var(--accent);font-weight:bold}
.course-live option{color:var(--color-foreground-primary,#222);
  background:var(--color-background-primary,#fff)}
.course-live :focus-visible{outline:2px solid var(--accent);outline-offset:2px}
.course-live .side>*{margin:0 0 .5rem}
.course-live label{display:block}
.course-live label.switch{display:flex;gap:.5em;align-items:center}
.course-live label select,.course-live label input[type=range]{display:block;width:100%;
  max-width:100%;box-sizing:border-box;accent-color:var(--accent)}
.course-live label input[type=range]{height:1.6em;margin:0}
.course-live .named{display:flex;gap:.8em;justify-content:space-between;align-items:baseline}
.course-live output{font-variant-numeric:tabular-nums;white-space:nowrap}
.course-live .wrong{border-left:4px solid #c1272d;padding:.2em .8em}
.course-live .quiet{color:var(--quiet)}
.course-simulation.in-page .course-side,.course-simulation .course-live .title{display:none}
.course-live .aloud{position:absolute;width:1px;height:1px;overflow:hidden;clip-path:inset(50%);
  white-space:nowrap}
@media print{.course-live .side{display:none}.course-live canvas{height:auto!important}}
`;

const make = (tag, options = {}, ...children) => {
  const { dataset, ...rest } = options;
  const element = Object.assign(document.createElement(tag), rest);
  Object.assign(element.dataset, dataset);
  element.append(...children);
  return element;
};

export function dress() {
  if (document.getElementById("course-live-style")) return;
  document.head.append(make("style", { id: "course-live-style", textContent: STYLE }));
}

// The input that sets a control, with its words; `put` shows the value that the control has.
function field(input, changed) {
  const { name, label, unit, choices } = input;
  const dataset = { control: name };
  const named = unit ? `${label} [${unit}]` : label;
  if (choices.length) {
    const options = choices.map((words, value) => make("option", { value, textContent: words }));
    const menu = make("select", { dataset }, ...options);
    menu.addEventListener("change", () => changed(menu.value));
    return { shown: make("label", {}, label, menu), put: (value) => void (menu.value = value) };
  }
  if (input.switch) {
    const box = make("input", { type: "checkbox", dataset });
    box.addEventListener("change", () => changed(box.checked ? 1 : 0));
    const shown = make("label", { className: "switch" }, box, label);
    return { shown, put: (value) => void (box.checked = value !== 0) };
  }
  const slider = make("input", { type: "range", dataset });
  const value = make("output");
  Object.assign(slider, { min: input.low, max: input.high, step: input.step });
  slider.setAttribute("aria-label", named);
  slider.addEventListener("input", () => changed(slider.value));
  const put = (number) => {
    slider.value = number;
    value.textContent = written(number, input.kind === "f" ? input.decimals : 0);
    slider.setAttribute("aria-valuetext", value.textContent + (unit && ` ${unit}`));
  };
  const head = make("span", { className: "named" }, make("span", {}, named), value);
  return { shown: make("label", {}, head, slider), put };
}

// The pictures of a recording: a script beside the page, fetched when they are needed first.
const filmed = (name, address) =>
  new Promise((done, failed) => {
    const missing = () => failed(new Error("Its recording was not found beside this page."));
    const arrived = () => {
      if (window.courseFilms?.[name]) done(window.courseFilms[name]);
      else missing();
    };
    if (window.courseFilms?.[name]) return arrived();
    const script = make("script", { src: address, onload: arrived, onerror: missing });
    document.head.append(script);
  });

// The panel in the element `place`, whose saved picture stays until the first one is drawn. It is
// what `Panel` is in a notebook: it starts paused, a change of a control starts anew unless the
// control is live, Space plays and pauses, R resets.
export function panel(place, { declaration: told, wasm, pictures, film }) {
  dress();
  const saved = place.querySelector("img");
  const live = wasm !== null;
  const keys = live ? told.keys : [];
  const parts = make("div", { className: "picture" });
  const wrong = make("p", { className: "wrong", hidden: true });
  const aloud = make("div", { className: "aloud" });
  wrong.setAttribute("role", "alert");
  aloud.setAttribute("aria-live", "polite");

  let [experiment, picture] = [null, null];
  let [playing, seen, before, frames, timer] = [false, true, null, 0, 0];
  let [touched, waiting, moves] = [false, null, null];

  const say = () => {
    timer ||= setTimeout(
      () => {
        timer = 0;
        aloud.textContent = picture?.canvas.getAttribute("aria-label") ?? "";
      },
      playing ? PLAYING : STILL,
    );
  };
  const busy = () => (experiment?.remaining?.() ?? 0) > 0;
  const show = () => picture.show((frames += 1), experiment.picture());
  const proceed = () => {
    if (busy()) experiment.complete(BUDGET);
    show();
  };
  const follow = () => {
    for (const [input, { put }] of inputs) put(experiment.get(input));
    show();
  };
  // Whatever fails stops time and is said; the next thing that works takes it back. Portions that
  // follow by themselves are nothing that the reader has done.
  const act = (action, byReader = true) => {
    if (!experiment) return;
    try {
      action();
      wrong.hidden = true;
      if (byReader) touched = Boolean(place.dataset.ready);
      if (touched) say();
    } catch (error) {
      pause();
      wrong.textContent = `The simulation stopped. ${error.message}`;
      wrong.hidden = false;
    }
  };
  const pause = () => {
    playing = false;
    play.textContent = "Play";
  };
  const toggle = () => {
    if (!experiment) return;
    if (playing) return pause();
    [playing, before] = [true, null];
    play.textContent = "Pause";
    picture.request();
  };
  const tick = (now) => {
    if (!seen) return void (before = null);
    if (moves && !busy()) {
      const [x, y] = moves;
      moves = null;
      drag("move", x, y);
    }
    if (!playing) {
      before = null;
      if (busy()) act(proceed, false);
      return;
    }
    // The first picture after a pause or out of sight only sets the clock.
    const passed = before === null ? 0 : (now - before) / 1000;
    before = now;
    act(() => {
      experiment.advance(Math.max(passed, 0));
      proceed();
    });
  };
  // A drag waits until the picture of the previous place is complete; then the newest one counts.
  const drag = (kind, x, y) => {
    if (kind === "move" && busy()) return void (moves = [x, y]);
    act(() => {
      if (kind === "down") experiment.grab(x, y);
      experiment.drag(x, y);
      follow();
    });
  };
  const step = () => {
    pause();
    act(() => {
      experiment.advance(STEP);
      show();
    });
  };
  const reset = () =>
    act(() => {
      experiment.start();
      show();
    });
  const choose = async () => {
    const preset = told.presets[menu.selectedIndex];
    note.textContent = preset.note;
    await experiment?.load?.(preset);
    act(() => {
      experiment.choose(preset);
      follow();
    });
  };

  const button = (words, clicked, className = "") => {
    const made = make("button", { type: "button", textContent: words, className });
    made.addEventListener("click", clicked);
    return made;
  };
  const play = button("Play", toggle, "play");
  const buttons = make("div", { className: "buttons" }, play);
  buttons.append(button("Step", step), button("Reset", reset));
  const options = told.presets.map(({ name }) => make("option", { textContent: name }));
  const menu = make("select", {}, ...options);
  menu.addEventListener("change", choose);
  if (told.presets.some(({ name }) => name === place.dataset.preset))
    menu.value = place.dataset.preset;
  const note = make("p", { className: "note" });
  const inputs = new Map(
    (live ? told.inputs : []).map((input) => {
      const changed = (value) =>
        act(() => {
          experiment.set(input, value);
          inputs.get(input).put(experiment.get(input));
          show();
        });
      return [input, field(input, changed)];
    }),
  );
  const side = make("div", { className: "side" }, buttons, make("label", {}, "Preset", menu), note);
  if (!live) {
    const words = `Recorded: these pictures were computed beforehand, as ${told.recorded}.`;
    side.append(make("p", { className: "quiet", textContent: words }));
  }
  const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (calm) {
    const words = "Your system asks for less motion: nothing moves before Play, Step shows one picture.";
    side.append(make("p", { className: "quiet", textContent: words }));
  }
  side.append(...[...inputs.values()].map(({ shown }) => shown));
  const word = make("small", { textContent: live ? "live" : "recorded" });
  const head = make("div", { className: "title" }, told.title, word);
  if (saved) parts.append(saved);
  place.replaceChildren(head, make("div", { className: "parts" }, parts, side), wrong, aloud);
  place.setAttribute("role", "group");
  place.setAttribute("aria-label", told.title);

  const begin = async () => {
    const made = live
      ? await compiled(told, bytesOf(wasm))
      : await recorded(told, pictures ?? (await filmed(told.name, film)));
    picture = view(parts, told.paper, {
      pointer(kind, x, y) {
        if (kind !== "move") moves = null;
        drag(kind, x, y);
      },
      key(key) {
        if (key === " ") toggle();
        else if (key === "r" || key === "R") reset();
        else
          act(() => {
            experiment.press(keys.indexOf(key));
            follow();
          });
      },
      tick,
      drawn() {
        saved?.remove();
        if (playing || busy() || moves) picture.request();
      },
    });
    const drags = live && told.functions.includes("drag");
    picture.listen(drags, [" ", "r", "R", ...keys], told.upright);
    if (saved) saved.style.position = "absolute"; // until the first picture is drawn in its place
    experiment = made;
    place.courseLive = experiment;
    await choose();
    place.dataset.ready = live ? "live" : "recorded";
    // On the home page it moves at once, unless the reader's system asks for less motion.
    if (place.dataset.plays !== undefined && !calm && !playing) toggle();
    if (waiting) adopt(...waiting);
  };
  // Go on from where another one has come to, unless something has been done here meanwhile.
  const adopt = (preset, records) => {
    if (!place.dataset.ready) waiting = [preset, records];
    else if (!touched)
      act(() => {
        menu.value = preset;
        note.textContent = told.presets[menu.selectedIndex].note;
        experiment.take(records);
        follow();
      });
  };
  const fail = (error) => {
    wrong.textContent = `The simulation does not run here, its saved picture stays. ${error.message}`;
    wrong.hidden = false;
  };
  // It is made once it comes near the screen, and time runs only while it is on it.
  let begun = false;
  const observer = new IntersectionObserver(
    (entries) => {
      seen = entries[entries.length - 1].isIntersecting; // entries come oldest first
      if (seen && !begun) {
        begun = true;
        begin().catch(fail);
      } else if (seen && (playing || busy())) picture.request();
    },
    { rootMargin: "100px" },
  );
  observer.observe(place);
  return {
    adopt,
    // Stop for good; the preset and the records it has come to, if it had begun.
    leave() {
      pause();
      observer.disconnect();
      picture?.close();
      return [menu.value, experiment?.records()];
    },
  };
}

export function mount() {
  for (const place of document.querySelectorAll(".course-live:not([data-mounted])")) {
    place.dataset.mounted = "";
    const bundle = window.courseSimulations?.[place.dataset.simulation];
    const say = (words) => place.append(make("p", { className: "wrong", textContent: words }));
    if (!bundle) say("The simulation was not found beside this page: this is its saved picture.");
    else if (bundle.wasm !== null && typeof WebAssembly !== "object")
      say("This browser runs no WebAssembly: this is the simulation's saved picture.");
    else panel(place, bundle);
  }
}
