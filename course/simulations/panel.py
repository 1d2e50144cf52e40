"""The panel of a simulation: its picture, its controls, its numbers, and play, step and reset.

`Panel` is the view of one `Experiment` with any model.
"""

import asyncio
import contextlib
import html
import threading
import time
from collections.abc import Iterator, Mapping
from typing import Any

import ipywidgets

from course.simulations import declaration
from course.simulations.canvas import Canvas, Pointer, bundle
from course.simulations.model import KEYS, Experiment, Model
from course.simulations.record import Field

_PICTURES_PER_SECOND = 40.0
# As wide as the column of the controls; `panel.css` puts the label above.
_WIDE = {"layout": {"width": "auto"}}
# After a pause of the kernel the simulation goes on from where it was, it does not catch up [s].
_LONGEST_ADVANCE = 0.1
# How far into its motion a saved notebook shows a simulation, where no kernel runs [s].
_STILL = 3.0


class Panel(ipywidgets.VBox):
    """Picture, controls and numbers of a simulation. It starts paused.

    A change of a control starts the experiment anew, so the picture always belongs to the settings
    beside it, unless the model says that it acts on the running state. Space plays and pauses, R
    resets, while the picture has the focus; what other keys do is up to the model.

    Args:
        model: what is simulated.
        still: how far into its motion a saved notebook shows it [s].
    """

    def __init__(self, model: Model, still: float = _STILL) -> None:
        self.model = model
        self.still = still
        self.experiment = Experiment(model)
        self.experiment.choose(next(iter(model.presets)))
        # Callbacks may come from another thread than cells: JupyterLab sends them to a subshell.
        self._lock = threading.RLock()
        self._setting = False
        self._task: asyncio.Task[None] | None = None
        self._completing: asyncio.Task[None] | None = None
        self.canvas = Canvas(
            self.experiment.picture(), readouts=model.readouts, upright=model.upright
        )
        turns = KEYS if model.press is not None else ()
        self.canvas.on_key([" ", "r", "R", *turns], lambda key: self._key(key.key))
        if model.drag is not None:
            self.canvas.on_pointer(self._drag)
        name = declaration.name_of(model)
        if name and declaration.is_live(name):
            self.canvas._bundle = declaration.content(name)
            self.canvas.on_run(self._runs)
        self.inputs = {name: _input(field) for name, field in model.controls.panel()}
        for name, widget in self.inputs.items():
            widget.observe(lambda change, name=name: self._changed(name, change["new"]), "value")
        self._preset = ipywidgets.Dropdown(
            options=list(model.presets), tooltip="Preset", layout={"width": "auto"}
        )
        self._note, self.aside = ipywidgets.HTML(), ipywidgets.HTML()
        self._play = ipywidgets.Button(
            description="Play", icon="play", button_style="primary", layout={"width": "104px"}
        )
        self._reset = ipywidgets.Button(description="Reset", icon="undo", layout={"width": "104px"})
        self._play.on_click(lambda _: self.pause() if self.playing else self.play())
        self._reset.on_click(lambda _: self.reset())
        self._preset.observe(
            lambda change: None if self._setting else self._chosen(change["new"]), "value"
        )
        buttons = ipywidgets.HBox([self._play, self._reset])
        side = ipywidgets.VBox(
            [buttons, self._preset, self._note, *self.inputs.values()]
            + [self.aside] * (model.aside is not None),
            layout={"flex": "1 1 250px", "max_width": "346px"},
        )
        side.add_class("course-side")
        self.canvas.layout = ipywidgets.Layout(flex="3 1 400px", max_width="960px")
        super().__init__(
            [
                ipywidgets.HTML(f'<b style="font-size:15px">{html.escape(model.title)}</b>'),
                ipywidgets.Box(
                    [self.canvas, side],
                    layout={"display": "flex", "flex_flow": "row wrap", "width": "100%"},
                ),
            ]
        )
        self.add_class("course-simulation")
        self._follow()
        self._show_note()

    @property
    def controls(self) -> Any:
        """The record of the controls; `set` changes them."""
        return self.experiment.controls

    @property
    def state(self) -> Any:
        """The record of the state."""
        return self.experiment.state

    @property
    def playing(self) -> bool:
        """True while time runs."""
        return self._task is not None

    def play(self) -> None:
        """Let time run, in a task of the running event loop (that of the notebook's kernel).

        Raises:
            RuntimeError: no event loop runs; then `advance` is the way to let time pass.
        """
        with self._lock:
            if self._task is None:
                self._task = asyncio.get_running_loop().create_task(self._run())
                self._play.description, self._play.icon = "Pause", "pause"

    def pause(self) -> None:
        """Stop time."""
        with self._lock:
            task, self._task = self._task, None
            if task is not None:
                # Cancel from the loop's own thread: `cancel` is not thread-safe.
                task.get_loop().call_soon_threadsafe(task.cancel)
            self._play.description, self._play.icon = "Play", "play"
            self._show()

    def reset(self) -> None:
        """Back to the start, with the same settings; if it plays, it goes on playing."""
        with self._lock:
            self.experiment.start()
            self._show()

    def advance(self, seconds: float) -> None:
        """Let simulated time pass at once."""
        with self._lock:
            self.experiment.advance(seconds)
            self._show()

    def set(self, **values: Any) -> None:
        """Set controls, as their inputs do.

        Raises:
            ValueError: a value is not allowed.
        """
        with self._lock:
            self.experiment.set(**values)
            self._follow()

    def choose(self, preset: str) -> None:
        """Take the controls of a preset and start anew."""
        with self._lock:
            self.experiment.choose(preset)
            self._follow(preset)
            self._show_note()

    def close(self) -> None:
        """Stop time and remove the panel from the page."""
        self.pause()
        super().close()

    def _changed(self, name: str, value: Any) -> None:
        if not self._setting:
            with self._lock, self._at_once():
                self.experiment.set(**{name: value})
                self._show()

    def _chosen(self, preset: str) -> None:
        with self._lock, self._at_once():
            self.choose(preset)

    @contextlib.contextmanager
    def _at_once(self) -> Iterator[None]:
        """Answer with the first portion of what takes long; the others follow between messages."""
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            yield
            return
        self.experiment.in_portions = True
        try:
            yield
        finally:
            self.experiment.in_portions = False
        if self.experiment.remaining and self._completing is None:
            self._completing = loop.create_task(self._complete())

    async def _complete(self) -> None:
        """Do the remaining portions, one after another."""
        going = True
        while going:
            await asyncio.sleep(0.005)  # the picture, and what the page has sent, come first
            with self._lock:
                going = self.comm is not None and self.experiment.complete()
                if not going:
                    self._completing = None
                self._show()

    def _drag(self, pointer: Pointer) -> None:
        with self._lock, self._at_once():
            if pointer.kind == "down":
                self.experiment.grab(pointer.x, pointer.y)
            self.experiment.drag(pointer.x, pointer.y)
            self._follow()

    def _follow(self, preset: str = "") -> None:
        """Put the inputs where the controls are, and show the picture; the inputs don't answer."""
        # Observers of the inputs must not answer when the program itself moves them.
        self._setting = True
        try:
            self._preset.value = preset or self._preset.value
            for name, widget in self.inputs.items():
                widget.value = self.controls[name].item()
        finally:
            self._setting = False
        self._show()

    def _key(self, key: str) -> None:
        if key in ("r", "R"):
            self.reset()
        elif key in KEYS:
            with self._lock, self._at_once():
                self.experiment.press(key)
                self._follow()
        elif self.playing:
            self.pause()
        else:
            self.play()

    def _runs(self, content: Mapping[str, Any], buffers: list[Any]) -> None:
        """It is to run in the page from here on, or here from where the page has come to."""
        with self._lock, self._at_once():
            if content.get("where") == "page":
                # The page continues from these records, byte by byte.
                self.pause()
                message = {"type": "records", "preset": self._preset.value}
                self.canvas.send(message, [self.controls.tobytes(), self.state.tobytes()])
            elif len(buffers) == 2:
                # What a browser says is looked at before use; what is wrong changes nothing.
                with contextlib.suppress(ValueError):
                    self.experiment.take(*map(bytes, buffers))
                known = content.get("preset") in self.model.presets
                self._follow(content["preset"] if known else "")
                self._show_note()

    def _show(self) -> None:
        self.canvas.show(self.experiment.picture())
        if self.model.aside is not None:
            self.aside.value = html.escape(self.model.aside())

    def _show_note(self) -> None:
        note = self.model.presets[self._preset.value].note
        if self.model.recorded:
            note += " (Recorded: these pictures were computed beforehand.)"
        self._note.value = (
            '<div style="line-height:1.35;font-size:13px;white-space:normal">'
            f"{html.escape(note)}</div>"
        )

    async def _run(self) -> None:
        """Advance by the time that has passed and show; wait while nobody looks."""
        # Wait until the next picture is due, but always a little, so that the event loop gets its
        # turn.
        before = time.monotonic()
        while True:
            await asyncio.sleep(max(0.002, before + 1.0 / _PICTURES_PER_SECOND - time.monotonic()))
            now = time.monotonic()
            passed, before = min(now - before, _LONGEST_ADVANCE), now
            with self._lock:
                # Another task may have taken over, or the panel was closed, while this one slept.
                if self._task is not asyncio.current_task() or self.comm is None:
                    return
                if self.canvas.watched:
                    with self._at_once():
                        self.experiment.advance(passed)
                    self._show()

    def __repr__(self) -> str:
        return self.canvas.frame.text

    def _repr_mimebundle_(self, **_options: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        with self._lock:
            later = self.experiment.later(self.still)
        return bundle(self, self.canvas.frame, later)


def _input(field: Field) -> Any:
    """Return the widget that sets a field."""
    if field.switch:
        return ipywidgets.Checkbox(description=field.label, indent=False, layout={"width": "auto"})
    if field.choices:
        options = [(words, k) for k, words in enumerate(field.choices)]
        return ipywidgets.Dropdown(options=options, description=field.label, **_WIDE)
    label = f"{field.label} [{field.unit}]" if field.unit else field.label
    whole = isinstance(field.default, int)
    kind = ipywidgets.IntSlider if whole else ipywidgets.FloatSlider
    return kind(
        value=field.default,
        min=field.low,
        max=field.high,
        step=field.step,
        description=label,
        readout_format="d" if whole else f".{field.decimals}f",
        **_WIDE,
    )
