// The widget of a notebook: shows the pictures that the kernel draws, tells it what is done to them.

import { view } from "./canvas.js";

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

  const picture = view(el, paper, {
    pointer: (type, x, y) => model.send({ type, x, y }),
    key: (key) => model.send({ type: "key", key }),
    drawn: (id) => {
      if (!films) giveWay();
      model.send({ type: "drawn", id });
    },
  });

  const take = (id, view) => {
    const bytes = view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength);
    picture.show(id, new Float64Array(bytes));
  };
  const receive = (content, buffers) => {
    if (content.type === "frame") take(content.id, buffers[0]);
  };
  const listens = () => picture.listen(model.get("_pointer"), model.get("_keys"));
  listens();
  model.on("change:_pointer", listens);
  model.on("change:_keys", listens);
  model.on("msg:custom", receive);
  take(0, model.get("_first"));
  model.send({ type: "ready" });

  return () => {
    picture.close();
    for (const film of films ?? []) film.style.display = "";
    model.off("msg:custom", receive);
    model.off("change:_pointer", listens);
    model.off("change:_keys", listens);
    model.send({ type: "gone" });
  };
}

export default { render };
