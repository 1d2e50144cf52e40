// Draws what a pen wrote (course/simulations/pen.py): one frame is one array of float64, item after
// item, each its kind, how many numbers follow, a style, and points in units of the window or words.

const FONT = '"DejaVu Sans", "Segoe UI", "Helvetica Neue", Arial, sans-serif';
const [CUT, LINE, POLYGON, DISC, ARROW, TEXT, READOUT] = [0, 1, 2, 3, 4, 5, 6];
const ALIGN = { 0: "left", 0.5: "center", 1: "right" };
const BASELINE = { 0: "bottom", 0.5: "middle", 1: "top" };
const FAR = 1e7; // farther away than this a point is drawn here
const SLACK = 2; // what is cut off may stand out by this much: half of a line [pixels]
const LETTERS = 8; // no smaller ones however narrow the picture [pixels]
const NARROW = 0.7; // such are this narrow at most, so that words stay apart where there is room
const MINUS = "\u2212";
const SLOP = 8; // a finger that moved less than this may still be about to scroll [CSS pixels]

// --- Light and dark ------------------------------------------------------------------------------

const linear = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
const encoded = (v) => (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
const times = (rows, v) => rows.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);

// From linear sRGB to the cone responses of Oklab and to its coordinates, and back (Ottosson, 2020).
const TO_LMS = [
  [0.4122214708, 0.5363325363, 0.0514459929],
  [0.2119034982, 0.6806995451, 0.1073969566],
  [0.0883024619, 0.2817188376, 0.6299787005],
];
const TO_LAB = [
  [0.2104542553, 0.793617785, -0.0040720468],
  [1.9779984951, -2.428592205, 0.4505937099],
  [0.0259040371, 0.7827717662, -0.808675766],
];
const FROM_LAB = [
  [1, 0.3963377774, 0.2158037573],
  [1, -0.1055613458, -0.0638541728],
  [1, -0.0894841775, -1.291485548],
];
const FROM_LMS = [
  [4.0767416621, -3.3077115913, 0.2309699292],
  [-1.2684380046, 2.6097574011, -0.3413193965],
  [-0.0041960863, -0.7034186147, 1.707614701],
];

// The colour that stands for "#rrggbb" on a dark page: the same hue, and light where that is dark.
// White becomes the page's own near-black, black a soft white. Between them the curve keeps the
// contrast of each colour of the palette with the background above 4.5, as it is on white.
export function darkened(colour) {
  const rgb = [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16) / 255);
  const [light, a, b] = times(TO_LAB, times(TO_LMS, rgb.map(linear)).map(Math.cbrt));
  const wanted = 0.95 - 0.76 * Math.max(light, 0) ** 1.4;
  const lms = times(FROM_LAB, [wanted, a, b]).map((v) => v ** 3);
  const bytes = times(FROM_LMS, lms).map((v) => Math.round(255 * encoded(Math.min(Math.max(v, 0), 1))));
  return "#" + bytes.map((v) => v.toString(16).padStart(2, "0")).join("");
}

// Whether the page around a picture is dark: JupyterLab and Furo say so on the body, else the system.
export function isDark() {
  const { jpThemeLight, theme } = document.body.dataset;
  if (matchMedia("print").matches) return false;
  if (jpThemeLight) return jpThemeLight === "false";
  if (theme === "light" || theme === "dark") return theme === "dark";
  return matchMedia("(prefers-color-scheme: dark)").matches;
}

// Call back whenever that may have changed; what is returned stops it.
function whenThemeChanges(call) {
  const queries = ["(prefers-color-scheme: dark)", "print"].map((query) => matchMedia(query));
  const observer = new MutationObserver(call);
  observer.observe(document.body, { attributeFilter: ["data-theme", "data-jp-theme-light"] });
  for (const query of queries) query.addEventListener("change", call);
  return () => {
    observer.disconnect();
    for (const query of queries) query.removeEventListener("change", call);
  };
}

// --- The picture ---------------------------------------------------------------------------------

// A number as `written` in pen.py writes it.
export function written(value, form) {
  const digits = form % 20;
  const size = Math.abs(value);
  const power = form >= 40 || size >= 1e21;
  const words = power ? size.toExponential(digits) : size.toFixed(digits);
  const sign = value < 0 && Number(words) ? MINUS : form >= 20 && form < 40 ? "+" : "";
  return sign + words.replace("e+", "e").replace("-", MINUS);
}

// `wide` comes from the observer: asking the element would lay out the whole notebook for a frame.
// `ink` has the colours of the table and of the background, as the page is light or dark.
// Returns the readouts, or nothing where there is no room yet.
export function paint(canvas, paper, at, wide, ink = paper) {
  const [xmin, xmax, ymin, ymax] = paper.window;
  if (!wide) return null;
  const high = (wide * (ymax - ymin)) / (xmax - xmin);
  const ratio = window.devicePixelRatio || 1;
  const columns = Math.round(wide * ratio);
  const rows = Math.round(high * ratio);
  // Setting the size of a canvas clears it and its state, even where the size does not change.
  if (canvas.width !== columns || canvas.height !== rows) {
    canvas.width = columns;
    canvas.height = rows;
    canvas.style.height = `${high}px`;
  }
  const context = canvas.getContext("2d");
  const scale = columns / (xmax - xmin); // device pixels for one unit of the window
  const size = columns / paper.width; // device pixels for one pixel of the paper
  const near = (value) => Math.min(Math.max(value, -FAR), FAR);
  const px = (x) => (near(x) - xmin) * scale;
  const py = (y) => (ymax - near(y)) * scale;

  context.setTransform(1, 0, 0, 1, 0, 0);
  context.globalAlpha = 1;
  context.fillStyle = ink.background;
  context.fillRect(0, 0, columns, rows);
  context.lineJoin = "round";
  context.lineCap = "butt";
  context.save();

  const fillAndStroke = (fill, edge, width) => {
    if (fill >= 0) {
      context.fillStyle = ink.colours[fill];
      context.fill();
    }
    if (edge >= 0) {
      context.strokeStyle = ink.colours[edge];
      context.lineWidth = width * size;
      context.stroke();
    }
  };
  const join = (from, to) => {
    let words = "";
    for (let k = from; k < to; k += 2)
      words += at[k] < 0 ? paper.words[at[k + 1]] : written(at[k + 1], at[k]);
    return words;
  };

  // Shapes are cut off at the edges of their axes, words are not. A clipping region can only shrink,
  // so each new one begins from the saved state that has none.
  let [wanted, present] = [null, null];
  const cut = (rectangle) => {
    if (rectangle === present) return;
    present = rectangle;
    context.restore();
    context.save();
    if (rectangle) {
      context.beginPath();
      context.rect(...rectangle);
      context.clip();
    }
  };

  const readouts = [];
  let next = 0;
  while (next < at.length) {
    const kind = at[next];
    const start = next + 2;
    const end = start + at[next + 1];
    next = end;
    if (kind !== CUT) cut(kind === TEXT ? null : wanted);
    if (kind === CUT) {
      wanted = null;
      if (end > start) {
        const [left, low, right, top] = at.subarray(start, end);
        const slack = SLACK * size;
        const corner = [px(left) - slack, py(top) - slack];
        wanted = [...corner, px(right) + slack - corner[0], py(low) + slack - corner[1]];
      }
    } else if (kind === LINE) {
      const [colour, width, alpha, on, off] = at.subarray(start, end);
      context.globalAlpha = alpha;
      context.strokeStyle = ink.colours[colour];
      context.lineWidth = width * size;
      context.setLineDash(on ? [on * size, off * size] : []);
      context.beginPath();
      let pen = false; // NaN lifts the pen: the line is interrupted there
      for (let k = start + 5; k < end; k += 2) {
        const x = at[k];
        const y = at[k + 1];
        if (Number.isNaN(x) || Number.isNaN(y)) pen = false;
        else if (pen) context.lineTo(px(x), py(y));
        else {
          context.moveTo(px(x), py(y));
          pen = true;
        }
      }
      context.stroke();
      context.setLineDash([]);
    } else if (kind === POLYGON) {
      const [fill, edge, width, alpha] = at.subarray(start, end);
      context.globalAlpha = alpha;
      context.beginPath();
      for (let k = start + 4; k < end; k += 2) context.lineTo(px(at[k]), py(at[k + 1]));
      context.closePath();
      fillAndStroke(fill, edge, width);
    } else if (kind === DISC) {
      const [radius, fill, edge, width, alpha] = at.subarray(start, end);
      context.globalAlpha = alpha;
      for (let k = start + 5; k < end; k += 2) {
        context.beginPath();
        context.arc(px(at[k]), py(at[k + 1]), radius * scale, 0, 2 * Math.PI);
        fillAndStroke(fill, edge, width);
      }
    } else if (kind === ARROW) {
      const [colour, width, head, alpha, ...ends] = at.subarray(start, end);
      const [x0, y0, x1, y1] = [px(ends[0]), py(ends[1]), px(ends[2]), py(ends[3])];
      const length = Math.hypot(x1 - x0, y1 - y0);
      if (length > 0) {
        // The shaft ends at the base of the head, which is never longer than the arrow.
        const long = Math.min(head * size, length);
        const [ux, uy] = [(x1 - x0) / length, (y1 - y0) / length];
        const [bx, by] = [x1 - ux * long, y1 - uy * long];
        context.globalAlpha = alpha;
        context.strokeStyle = context.fillStyle = ink.colours[colour];
        context.lineWidth = width * size;
        context.beginPath();
        context.moveTo(x0, y0);
        context.lineTo(bx, by);
        context.stroke();
        context.beginPath();
        context.moveTo(x1, y1);
        context.lineTo(bx - 0.4 * uy * long, by + 0.4 * ux * long);
        context.lineTo(bx + 0.4 * uy * long, by - 0.4 * ux * long);
        context.closePath();
        context.fill();
      }
    } else if (kind === TEXT) {
      const [x, y, colour, letters, align, baseline] = at.subarray(start, end);
      const [right, up, turn, bold, alpha] = at.subarray(start + 6, end);
      context.globalAlpha = alpha;
      context.save();
      context.translate(px(x) + right * size, py(y) - up * size);
      context.rotate((-turn * Math.PI) / 180); // y points down on a canvas
      // Letters keep a legible height on a narrow picture and are condensed instead.
      const letter = Math.max(letters * size, Math.min(LETTERS, letters) * ratio);
      context.scale(Math.max((letters * size) / letter, NARROW), 1);
      context.font = `${bold ? "bold " : ""}${letter}px ${FONT}`;
      context.fillStyle = ink.colours[colour];
      context.textAlign = ALIGN[align];
      context.textBaseline = BASELINE[baseline];
      context.fillText(join(start + 11, end), 0, 0);
      context.restore();
    } else if (kind === READOUT) {
      readouts.push([paper.words[at[start]], join(start + 1, end)]);
    } else throw new Error(`no item of kind ${kind}`);
  }
  context.restore();
  return readouts;
}

// The numbers below the picture: name above value. What a number means, `explained` by its name, is
// a tooltip, and a click writes it below all of them: a finger has no tooltips.
function print(list, note, entries, explained) {
  if (list.children.length !== entries.length) {
    list.replaceChildren(
      ...entries.map(() => {
        const cell = document.createElement("div");
        const [name, value] = [document.createElement("div"), document.createElement("div")];
        cell.style.cssText = "flex:0 1 auto;min-width:104px;max-width:100%;cursor:help";
        name.style.cssText = "font-size:11px;opacity:0.75;text-decoration:underline dotted 1px;"
          + "text-underline-offset:2px";
        value.style.cssText = "font-size:14px;font-variant-numeric:tabular-nums";
        cell.append(name, value);
        cell.addEventListener("click", () => {
          const words = cell.title && `${name.textContent}: ${cell.title}`;
          note.textContent = note.textContent === words ? "" : words;
        });
        return cell;
      }),
    );
  }
  entries.forEach((entry, k) => {
    const cell = list.children[k];
    entry.forEach((words, part) => {
      const place = cell.children[part];
      if (place.textContent !== words) place.textContent = words;
    });
    const meaning = explained?.[entry[0]] ?? "";
    if (cell.title !== meaning) cell.title = meaning;
  });
}

// The picture and its numbers on a page, drawn again whenever there is something new to see. What
// happens to it is told to `hear`: pointer(kind, x, y), key(key), drawn(id, readouts) and, before
// each picture, tick(now), which may show a newer one.
export function view(place, paper, hear) {
  const canvas = document.createElement("canvas");
  canvas.className = "course-canvas";
  canvas.setAttribute("role", "img");
  canvas.dataset.lmSuppressShortcuts = "true"; // JupyterLab would take the arrows
  canvas.style.display = "block";
  canvas.style.width = "100%";
  const numbers = document.createElement("div");
  numbers.className = "course-numbers";
  numbers.style.cssText =
    "display:flex;flex-wrap:wrap;gap:6px 14px;margin:4px 8px 8px;line-height:1.35";
  const note = document.createElement("div");
  note.className = "course-meaning";
  note.style.cssText = "margin:0 8px 8px;font-size:12.5px;line-height:1.35";
  place.append(canvas, numbers, note);

  // What changes in here can't move anything outside, so the page need not be laid out again.
  place.style.contain = "layout style";

  let frame = null;
  let wide = 0;
  let requested = false;
  let move = null;
  let wanted = { pointer: false, keys: [], upright: true };
  let held = null; // a finger went down there, and it may be about to scroll the page

  const table = { colours: paper.colours, background: paper.background };
  const night = {
    colours: paper.colours.map(darkened),
    background: darkened(paper.background),
  };
  let ink = isDark() ? night : table;
  const stopWatching = whenThemeChanges(() => {
    ink = isDark() ? night : table;
    if (frame) paint(canvas, paper, frame.numbers, wide, ink); // at once: a printer does not wait
  });

  const request = () => {
    if (!requested) {
      requested = true;
      requestAnimationFrame(refresh);
    }
  };

  function refresh(now) {
    if (move) {
      hear.pointer(...move);
      move = null;
    }
    // Cleared after the tick: a picture shown in the tick is painted now, not requested again.
    hear.tick?.(now);
    requested = false;
    const readouts = frame && paint(canvas, paper, frame.numbers, wide, ink);
    if (readouts && frame.id !== Number(canvas.dataset.frame)) {
      const said = readouts.map(([name, value]) => `${name} ${value}`);
      canvas.setAttribute("aria-label", [paper.label, ...said].join(", "));
      print(numbers, note, readouts, paper.readouts);
      canvas.dataset.frame = frame.id;
      hear.drawn(frame.id, readouts);
    }
  }

  const at = (kind, event) => {
    const box = canvas.getBoundingClientRect();
    const [xmin, xmax, ymin, ymax] = paper.window;
    return [
      kind,
      xmin + ((event.clientX - box.left) / box.width) * (xmax - xmin),
      ymax - ((event.clientY - box.top) / box.height) * (ymax - ymin),
    ];
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (!frame || !wanted.pointer || event.button !== 0) return;
    // With the pointer captured a drag continues, and ends, outside of the canvas.
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true });
    held = null;
    if (event.pointerType === "touch" && !wanted.upright) held = event;
    else hear.pointer(...at("down", event));
  });
  const begin = () => {
    if (held) hear.pointer(...at("down", held));
    held = null;
  };
  canvas.addEventListener("pointermove", (event) => {
    if (!canvas.hasPointerCapture(event.pointerId)) return;
    if (held && Math.abs(event.clientX - held.clientX) < SLOP) return;
    begin();
    move = at("move", event); // one per picture is enough
    request();
  });
  const release = (event) => {
    if (!canvas.hasPointerCapture(event.pointerId)) return;
    canvas.releasePointerCapture(event.pointerId);
    // The browser cancels a pointer with which it scrolls: nothing was dragged then.
    const scrolled = held && event.type === "pointercancel";
    if (scrolled) held = null;
    begin();
    // A quick finger is gone before the next picture: where it went comes before that it left.
    if (move && !scrolled) hear.pointer(...move);
    move = null;
    if (!scrolled) hear.pointer(...at("up", event));
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("keydown", (event) => {
    if (!wanted.keys.includes(event.key)) return;
    event.preventDefault();
    event.stopPropagation(); // the notebook has its own shortcuts
    hear.key(event.key);
  });
  const observer = new ResizeObserver((entries) => {
    wide = entries[entries.length - 1].contentRect.width;
    request();
  });
  observer.observe(canvas);

  return {
    canvas,
    request,
    // A picture and its number; the array may be used again for the next one.
    show(id, numbers) {
      frame = { id, numbers };
      request();
    },
    // Which events are wanted: those of the pointer, and these keys. Where nothing is dragged up or
    // down (not `upright`) a finger that moves so scrolls the page.
    listen(pointer, keys, upright = true) {
      wanted = { pointer, keys, upright };
      canvas.style.touchAction = !pointer ? "auto" : upright ? "none" : "pan-y";
      canvas.style.cursor = pointer ? "grab" : "default";
      if (keys.length) canvas.tabIndex = 0;
      else canvas.removeAttribute("tabindex");
    },
    close() {
      observer.disconnect();
      stopWatching();
    },
  };
}
