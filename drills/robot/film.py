"""An animation of your robot as one HTML file: it needs no network, and a notebook shows it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from drills.robot import cell as scene
from drills.robot.cell import Level, Task
from drills.robot.levels import CELL
from drills.robot.loop import SIGNALS
from drills.robot.play import Played

STEP = 4 * CELL.tick  # s between two postures of the log

_PAGE = """<div class="robot-film" style="font:14px sans-serif">
<canvas width="760" height="430" style="max-width:100%;background:#fff"></canvas>
<div><button type="button">Pause</button> <input type="range" min="0" value="0" style="width:60%">
<select></select></div></div>
<script>
(() => {
const films = FILMS;
const box = document.currentScript.previousElementSibling;
const [canvas, button, slider, select] =
  ["canvas", "button", "input", "select"].map((n) => box.querySelector(n));
const pen = canvas.getContext("2d");
films.forEach((f, i) => select.add(new Option(f.title, i)));
let film = films[0], k = 0, running = true;
const at = (x, y) => [380 + 400 * x, 385 - 400 * y];
const disc = (x, y, r, colour) => {
  pen.fillStyle = colour; pen.beginPath();
  pen.arc(...at(x, y), Math.max(2, 400 * r), 0, 7); pen.fill();
};
function draw() {
  const now = Math.min(k, film.q.length - 1), q = film.q[now], part = film.part[now];
  pen.clearRect(0, 0, 760, 430);
  film.posts.forEach((p) => disc(p[0], p[1], p[2], "#9aa0a6"));
  film.clutter.forEach((p) => disc(p[0], p[1], 0.03, "#dadce0"));
  pen.strokeStyle = "#1b6e35"; pen.lineWidth = 2; pen.beginPath();
  pen.arc(...at(...film.slot), 14, 0, 7); pen.stroke();
  disc(part[0], part[1], 0.025, "#c5221f");
  const elbow = [film.lengths[0] * Math.cos(q[0]), film.lengths[0] * Math.sin(q[0])];
  const tip = [elbow[0] + film.lengths[1] * Math.cos(q[0] + q[1]),
               elbow[1] + film.lengths[1] * Math.sin(q[0] + q[1])];
  pen.strokeStyle = "#1a56b0"; pen.lineWidth = 14; pen.lineCap = "round"; pen.lineJoin = "round";
  pen.beginPath(); pen.moveTo(...at(0, 0)); pen.lineTo(...at(...elbow)); pen.lineTo(...at(...tip));
  pen.globalAlpha = 0.75; pen.stroke(); pen.globalAlpha = 1;
  pen.fillStyle = "#202124";
  pen.fillText(film.title + ": " + film.text, 10, 18);
  pen.fillText((k * film.step).toFixed(2) + " s", 10, 36);
  slider.max = film.q.length - 1; slider.value = k;
}
button.onclick = () => { running = !running; button.textContent = running ? "Pause" : "Play"; };
slider.oninput = () => { k = +slider.value; draw(); };
select.onchange = () => { film = films[+select.value]; k = 0; draw(); };
let last = 0;
function tick(now) {
  if (running && now - last > 1000 * film.step) {
    last = now; k = (k + 1) % (film.q.length + 40); draw();
  }
  if (box.isConnected) requestAnimationFrame(tick);
}
draw(); requestAnimationFrame(tick);
})();
</script>
"""


def lesson(played: Played) -> int:
    """Return the task that teaches most: of the most frequent failure the one that went farthest.

    Without a failure it is the task with the largest error.
    """
    counts: dict[str, int] = {}
    for why in played.why:
        if why:
            counts[why] = counts.get(why, 0) + 1
    if not counts:
        return int(played.numbers[int(np.nanargmax(np.hypot(*played.error.T)))])
    frequent = max(counts, key=lambda why: counts[why])
    rows = [i for i, why in enumerate(played.why) if why == frequent]
    size = np.nan_to_num(np.hypot(*played.error[rows].T))
    size = np.where(size > 0.0, size, np.nan_to_num(np.hypot(*played.grasp[rows].T)))
    return int(played.numbers[rows[int(np.argmax(size))]])


def path_of_part(task: Task, played: Played, i: int, q: np.ndarray) -> np.ndarray:
    """Return where the part is at each posture of the log, shape (k, 2) [m]."""
    grip, release = played.moments[i]
    times = STEP * np.arange(len(q))
    part = task.part + times[:, None] * task.velocity
    if math.isfinite(grip):
        tips = np.array([scene.tip_of(CELL.lengths, one) for one in q]).reshape(-1, 2)
        held = times >= grip
        start = int(np.argmax(held)) if held.any() else len(q) - 1
        part[held] = tips[held] + part[start] - tips[start]
    if math.isfinite(release):
        part[times >= release - STEP] = played.signals[i, SIGNALS.index("part_at_rest")]
    return part


def film(played: Played, level: Level, seed: int, numbers: list[int]) -> str:
    """Return the animation of some tasks as HTML.

    Args:
        played: with the motions of these tasks.
        level: that was played.
        seed: of the tasks.
        numbers: of the tasks, in the order of the list.
    """
    films: list[dict[str, Any]] = []
    for number in numbers:
        i = int(np.flatnonzero(played.numbers == number)[0])
        q = played.logs[number]
        task = scene.make_task(CELL, level, seed, number)
        text = played.why[i] or f"in its slot, {1e3 * math.hypot(*played.error[i]):.1f} mm off"
        films.append(
            {
                "title": f"task {number}",
                "text": text,
                "step": STEP,
                "lengths": list(CELL.lengths),
                "q": np.round(q, 4).tolist(),
                "part": np.round(path_of_part(task, played, i, q), 4).tolist(),
                "posts": np.round(task.posts, 4).tolist(),
                "clutter": np.round(task.clutter[:, :2], 4).tolist(),
                "slot": np.round(task.slot, 4).tolist(),
            }
        )
    return _PAGE.replace("FILMS", json.dumps(films))


def page(html: str) -> str:
    """Return a whole page around an animation."""
    head = '<!DOCTYPE html><meta charset="utf-8"><title>Your robot</title>'
    return f'{head}<body style="margin:1em">{html}</body>\n'


def show(path: str | Path) -> Any:
    """Show an animation in a notebook.

    Args:
        path: the file that `drills robot film` wrote.
    """
    from IPython.display import HTML

    return HTML(Path(path).read_text(encoding="utf-8"))
