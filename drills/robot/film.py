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
# What is drawn: its colour, and its name in the legend.
LEGEND = {
    "arm": ("#1a56b0", "the arm"),
    "part": ("#c5221f", "the part to pick up"),
    "slot": ("#1b6e35", "the slot that it goes into"),
    "post": ("#80868b", "posts that the arm must not touch"),
    "other": ("#dadce0", "other objects"),
}

SHADES = {
    "the arm at the start": "#a9c6f0",
    "the arm at the grip": "#5b8fdc",
    "the arm at the release": "#1a4a94",
}

_PAGE = """<div class="robot-film" style="font:14px sans-serif">
<canvas width="760" height="550" style="max-width:100%;background:#fff"></canvas>
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
const at = (x, y) => [380 + 340 * x, 335 - 340 * y];
const disc = (x, y, r, colour) => {
  pen.fillStyle = colour; pen.beginPath();
  pen.arc(...at(x, y), Math.max(2, 340 * r), 0, 7); pen.fill();
};
const legend = LEGEND;
function draw() {
  const now = Math.min(k, film.q.length - 1), q = film.q[now], part = film.part[now];
  pen.clearRect(0, 0, 760, 550);
  film.posts.forEach((p) => disc(p[0], p[1], p[2], legend.post[0]));
  film.clutter.forEach((p) => disc(p[0], p[1], 0.03, legend.other[0]));
  pen.strokeStyle = legend.slot[0]; pen.lineWidth = 2; pen.beginPath();
  pen.arc(...at(...film.slot), 14, 0, 7); pen.stroke();
  disc(part[0], part[1], 0.025, legend.part[0]);
  const elbow = [film.lengths[0] * Math.cos(q[0]), film.lengths[0] * Math.sin(q[0])];
  const tip = [elbow[0] + film.lengths[1] * Math.cos(q[0] + q[1]),
               elbow[1] + film.lengths[1] * Math.sin(q[0] + q[1])];
  pen.strokeStyle = legend.arm[0]; pen.lineWidth = 14;
  pen.lineCap = "round"; pen.lineJoin = "round";
  pen.beginPath(); pen.moveTo(...at(0, 0)); pen.lineTo(...at(...elbow)); pen.lineTo(...at(...tip));
  pen.globalAlpha = 0.75; pen.stroke(); pen.globalAlpha = 1;
  pen.fillStyle = "#202124";
  pen.font = "14px sans-serif";
  const seconds = now * film.step, end = k >= film.q.length - 1;
  const phase = film.grip === null || seconds < film.grip ? "before the grip"
    : film.release === null || seconds < film.release ? "carries the part" : "released";
  pen.fillText(`${film.title}, ${seconds.toFixed(2)} s: ${end ? film.text : phase}`, 10, 20);
  Object.values(legend).forEach(([colour, name], i) => {
    pen.fillStyle = colour; pen.fillRect(12, 452 + 19 * i, 12, 12);
    pen.fillStyle = "#202124"; pen.fillText(name, 32, 463 + 19 * i);
  });
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
                "grip": _finite(played.moments[i, 0]),
                "release": _finite(played.moments[i, 1]),
            }
        )
    return _PAGE.replace("FILMS", json.dumps(films)).replace("LEGEND", json.dumps(LEGEND))


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def still(played: Played, level: Level, seed: int, number: int, path: Path) -> None:
    """Write a picture of one task: the arm at its start, at the grip and at the release.

    Args:
        played: with the motion of this task, a success.
        level: that was played.
        seed: of the tasks.
        number: of the task.
        path: of the picture, a PNG.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    i = int(np.flatnonzero(played.numbers == number)[0])
    task, q = scene.make_task(CELL, level, seed, number), played.logs[number]
    part = path_of_part(task, played, i, q)
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for j, (x, y, radius) in enumerate(task.posts):
        name = "posts that the arm must not touch" if j == 0 else None
        axes.add_patch(Circle((x, y), radius, color=LEGEND["post"][0], label=name))
    moments = (0, *(min(round(t / STEP), len(q) - 1) for t in played.moments[i]))
    for k, (name, shade) in zip(moments, SHADES.items(), strict=True):
        elbow = CELL.lengths[0] * np.array([math.cos(q[k, 0]), math.sin(q[k, 0])])
        x, y = np.transpose([np.zeros(2), elbow, scene.tip_of(CELL.lengths, q[k])])
        ends: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round"}
        axes.plot(x, y, "-", color=shade, linewidth=9, alpha=0.9, label=name, **ends)
    tips = np.array([scene.tip_of(CELL.lengths, one) for one in q])
    axes.plot(*tips.T, ":", color="0.3", label="path of the gripper")
    axes.plot(*part[0], "s", color=LEGEND["part"][0], markersize=13, label="the part at the start")
    ring: dict[str, Any] = {"markersize": 19, "markeredgewidth": 2.5, "markerfacecolor": "none"}
    axes.plot(*task.slot, "o", color=LEGEND["slot"][0], label=LEGEND["slot"][1], **ring)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y, up the table [m]")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, markerscale=0.6)
    figure.savefig(path, format="png", dpi=110)


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
