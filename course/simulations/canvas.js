// Draws the display list of course/simulations/canvas.py. One message is one frame: how to draw
// each item (JSON) and all coordinates in world units (float32 pairs).

const FONT = '"DejaVu Sans", "Segoe UI", "Helvetica Neue", Arial, sans-serif';

// `wide` comes from the observer: asking the element would lay out the whole notebook for a frame.
function paint(canvas, frame, wide) {
  const [xmin, xmax, ymin, ymax] = frame.window;
  if (!wide) return false;
  const high = (wide * (ymax - ymin)) / (xmax - xmin);
  const ratio = window.devicePixelRatio || 1;
  const columns = Math.round(wide * ratio);
  const rows = Math.round(high * ratio);
  if (canvas.width !== columns || canvas.height !== rows) {
    canvas.width = columns;
    canvas.height = rows;
    canvas.style.height = `${high}px`;
  }
  const context = canvas.getContext("2d");
  const scale = columns / (xmax - xmin); // device pixels for one world unit
  const size = columns / frame.width; // device pixels for one pixel of the frame
  const px = (x) => (x - xmin) * scale;
  const py = (y) => (ymax - y) * scale;
  const at = frame.coordinates;

  context.setTransform(1, 0, 0, 1, 0, 0);
  context.globalAlpha = 1;
  context.fillStyle = frame.background;
  context.fillRect(0, 0, columns, rows);
  context.lineJoin = "round";
  context.lineCap = "butt";

  const fillAndStroke = (fill, edge, width) => {
    if (fill) {
      context.fillStyle = fill;
      context.fill();
    }
    if (edge) {
      context.strokeStyle = edge;
      context.lineWidth = width * size;
      context.stroke();
    }
  };

  let next = 0;
  for (const [kind, count, ...style] of frame.items) {
    const start = 2 * next;
    next += count;
    context.globalAlpha = style[style.length - 1];
    if (kind === "line") {
      const [colour, width, dash] = style;
      context.strokeStyle = colour;
      context.lineWidth = width * size;
      context.setLineDash(dash.map((part) => part * size));
      context.beginPath();
      let pen = false;
      for (let k = start; k < start + 2 * count; k += 2) {
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
    } else if (kind === "polygon") {
      const [fill, edge, width] = style;
      context.beginPath();
      for (let k = start; k < start + 2 * count; k += 2) context.lineTo(px(at[k]), py(at[k + 1]));
      context.closePath();
      fillAndStroke(fill, edge, width);
    } else if (kind === "disc") {
      const [radius, fill, edge, width] = style;
      for (let k = start; k < start + 2 * count; k += 2) {
        context.beginPath();
        context.arc(px(at[k]), py(at[k + 1]), radius * scale, 0, 2 * Math.PI);
        fillAndStroke(fill, edge, width);
      }
    } else if (kind === "arrow") {
      const [colour, width, head] = style;
      const [x0, y0, x1, y1] = [px(at[start]), py(at[start + 1]), px(at[start + 2]), py(at[start + 3])];
      const length = Math.hypot(x1 - x0, y1 - y0);
      if (length > 0) {
        const long = Math.min(head * size, length);
        const [ux, uy] = [(x1 - x0) / length, (y1 - y0) / length];
        const [bx, by] = [x1 - ux * long, y1 - uy * long];
        context.strokeStyle = colour;
        context.fillStyle = colour;
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
    } else if (kind === "text") {
      const [words, colour, letters, align, baseline, right, up, turn, bold] = style;
      context.save();
      context.translate(px(at[start]) + right * size, py(at[start + 1]) - up * size);
      context.rotate((-turn * Math.PI) / 180);
      context.font = `${bold ? "bold " : ""}${letters * size}px ${FONT}`;
      context.fillStyle = colour;
      context.textAlign = align;
      context.textBaseline = baseline;
      context.fillText(words, 0, 0);
      context.restore();
    }
  }
  return true;
}

// The numbers below the picture: name above value.
function print(list, entries) {
  if (list.children.length !== entries.length) {
    list.replaceChildren(
      ...entries.map(() => {
        const cell = document.createElement("div");
        const [name, value] = [document.createElement("div"), document.createElement("div")];
        cell.style.cssText = "flex:0 0 112px";
        name.style.cssText = "font-size:11px;opacity:0.7;white-space:nowrap";
        value.style.cssText = "font-size:14px;font-variant-numeric:tabular-nums;white-space:nowrap";
        cell.append(name, value);
        return cell;
      }),
    );
  }
  entries.forEach((entry, k) =>
    entry.forEach((words, part) => {
      const place = list.children[k].children[part];
      if (place.textContent !== words) place.textContent = words;
    }),
  );
}

function render({ model, el }) {
  const canvas = document.createElement("canvas");
  canvas.className = "course-canvas";
  canvas.setAttribute("role", "img");
  canvas.style.display = "block";
  canvas.style.width = "100%";
  const numbers = document.createElement("div");
  numbers.className = "course-numbers";
  numbers.style.cssText =
    "display:flex;flex-wrap:wrap;gap:6px 10px;margin:4px 8px 8px;line-height:1.35";
  el.append(canvas, numbers);

  // What changes in here can't move anything outside, so the page need not be laid out again.
  el.style.contain = "layout style";

  let frame = null;
  let wide = 0;
  let requested = false;
  let move = null;

  const request = () => {
    if (!requested) {
      requested = true;
      requestAnimationFrame(refresh);
    }
  };

  function refresh() {
    requested = false;
    if (move) {
      model.send(move);
      move = null;
    }
    if (frame && paint(canvas, frame, wide) && frame.id !== Number(canvas.dataset.frame)) {
      const said = frame.numbers.map(([name, value]) => `${name} ${value}`);
      canvas.setAttribute("aria-label", [frame.label, ...said].join(", "));
      print(numbers, frame.numbers);
      canvas.dataset.frame = frame.id;
      model.send({ type: "drawn", id: frame.id });
    }
  }

  const receive = (content, buffers) => {
    if (content.type !== "frame") return;
    const view = buffers[0];
    const bytes = view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength);
    frame = { ...content, coordinates: new Float32Array(bytes) };
    request();
  };

  const pointer = (kind, event) => {
    const box = canvas.getBoundingClientRect();
    const [xmin, xmax, ymin, ymax] = frame.window;
    return {
      type: kind,
      x: xmin + ((event.clientX - box.left) / box.width) * (xmax - xmin),
      y: ymax - ((event.clientY - box.top) / box.height) * (ymax - ymin),
    };
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (!frame || !model.get("_pointer") || event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    canvas.focus();
    model.send(pointer("down", event));
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!canvas.hasPointerCapture(event.pointerId)) return;
    move = pointer("move", event); // one per picture is enough
    request();
  });
  const release = (event) => {
    if (!canvas.hasPointerCapture(event.pointerId)) return;
    canvas.releasePointerCapture(event.pointerId);
    move = null;
    model.send(pointer("up", event));
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("keydown", (event) => {
    if (!model.get("_keys").includes(event.key)) return;
    event.preventDefault();
    event.stopPropagation(); // the notebook has its own shortcuts
    model.send({ type: "key", key: event.key });
  });

  const listens = () => {
    canvas.style.touchAction = model.get("_pointer") ? "none" : "auto";
    canvas.style.cursor = model.get("_pointer") ? "grab" : "default";
    if (model.get("_keys").length) canvas.tabIndex = 0;
    else canvas.removeAttribute("tabindex");
  };
  listens();
  model.on("change:_pointer", listens);
  model.on("change:_keys", listens);
  model.on("msg:custom", receive);
  const observer = new ResizeObserver((entries) => {
    wide = entries[entries.length - 1].contentRect.width;
    request();
  });
  observer.observe(canvas);
  model.send({ type: "ready" });

  return () => {
    observer.disconnect();
    model.off("msg:custom", receive);
    model.off("change:_pointer", listens);
    model.off("change:_keys", listens);
    model.send({ type: "gone" });
  };
}

export default { render };
