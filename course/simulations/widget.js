// The widget of a notebook: shows the pictures that the kernel draws, tells it what is done to them.

import { view } from "./canvas.js";
import { dress, panel } from "./live.js";

const rawOf = (view) => new Uint8Array(view.buffer, view.byteOffset, view.byteLength);

function render({ model, el }) {
  const paper = model.get("_paper");

  // A notebook shows a film of the simulation, so that something moves before a kernel runs and
  // while it is busy; once the live picture is there, the film gives way to it.
  let films = null;
  const giveWay = () => {
    const page = el.closest(".jp-Notebook") ?? document;
    films = [...page.querySelectorAll("img")].filter((film) => film.alt === paper.label);
    for (const film of films) film.style.display = "none";
  };

  const kernel = document.createElement("div");
  el.append(kernel);
  const picture = view(kernel, paper, {
    pointer: (type, x, y) => model.send({ type, x, y }),
    key: (key) => model.send({ type: "key", key }),
    drawn: (id) => {
      if (!films) giveWay();
      model.send({ type: "drawn", id });
    },
  });

  const take = (id, view) => {
    // A view from Jupyter may begin at any byte; a Float64Array needs a multiple of eight: copy.
    picture.show(id, new Float64Array(rawOf(view).slice().buffer));
  };
  const receive = (content, buffers) => {
    if (content.type === "frame") take(content.id, buffers[0]);
    if (content.type === "records") here?.adopt(content.preset, buffers.map(rawOf));
  };

  // Where a simulation is compiled the page can run it, so that no picture waits for the kernel.
  // Both keep the same records, and what runs goes on from where the other one was; only a kernel
  // that is busy cannot tell, then the page begins anew.
  let here = null;
  const runs = (where) => {
    el.closest(".course-simulation")?.classList.toggle("in-page", where === "page");
    kernel.style.display = where === "page" ? "none" : "";
    if (where === "page") {
      const place = document.createElement("div");
      place.className = "course-live";
      el.prepend(place);
      here = panel(place, model.get("_bundle"));
      // Arrows are the sliders', not the notebook's.
      for (const input of place.querySelectorAll("input, select"))
        input.dataset.lmSuppressShortcuts = "true";
      model.send({ type: "runs", where });
    } else {
      const [preset, records] = here.leave();
      here = null;
      el.firstElementChild.remove();
      model.send({ type: "runs", where, preset }, undefined, records ?? []);
    }
  };
  if (model.get("_bundle").wasm) {
    dress();
    const choice = document.createElement("label");
    const box = document.createElement("input");
    box.type = "checkbox";
    box.addEventListener("change", () => runs(box.checked ? "page" : "kernel"));
    choice.style.cssText = "display:block;margin:0 8px 8px;font-size:12px";
    choice.append(box, " runs in this page, not in the kernel");
    el.append(choice);
  }
  const listens = () =>
    picture.listen(model.get("_pointer"), model.get("_keys"), model.get("_upright"));
  listens();
  model.on("change:_pointer", listens);
  model.on("change:_keys", listens);
  model.on("msg:custom", receive);
  take(0, model.get("_first"));
  model.send({ type: "ready" });

  return () => {
    here?.leave();
    picture.close();
    for (const film of films ?? []) film.style.display = "";
    model.off("msg:custom", receive);
    model.off("change:_pointer", listens);
    model.off("change:_keys", listens);
    model.send({ type: "gone" });
  };
}

export default { render };
