"""The panel of a simulation: its picture, its controls, its numbers, and play, step and reset.

A simulation is a `Model`: what can be set and within which limits, and pure functions from
(state, controls) to the next state and to a `Frame`. `Panel` is the view of any model.
"""

import asyncio
import html
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import ipywidgets

from course.simulations.canvas import Canvas, Pointer, bundle

_PICTURES_PER_SECOND = 40.0
# After a pause of the kernel the simulation goes on from where it was, it does not catch up [s].
_LONGEST_ADVANCE = 0.1


@dataclass(frozen=True)
class Slider:
    """A number that can be set: its label, its limits (both allowed), its step and its unit."""

    label: str
    low: float
    high: float
    step: float
    unit: str = ""
    form: str = ".2f"

    def check(self, name: str, value: float) -> None:
        """Raise ValueError if the value is not within the limits."""
        if not self.low <= value <= self.high:
            limits = f"{self.low:g} to {self.high:g} {self.unit}".strip()
            raise ValueError(f"{name} is {value}, allowed is {limits}")


@dataclass(frozen=True)
class Preset:
    """Controls worth looking at, and what to look for (plain text)."""

    controls: Any
    note: str


@dataclass(frozen=True)
class Model:
    """What a panel needs to know of a simulation.

    Attributes:
        title: name of the simulation.
        controls: its defaults, a frozen dataclass.
        sliders, menus, switches: how to set fields of the controls, by the name of the field: a
            slider; a label and the values to choose from (what is shown: value); a label.
        presets: by name; the first one is what the panel starts with.
        initial: controls -> state.
        advance: (state, controls, seconds) -> state.
        frame: (state, controls) -> Frame, the picture and the numbers.
        drag: (controls, state, pointer) -> controls, if things can be moved in the picture.
    """

    title: str
    controls: Any
    sliders: Mapping[str, Slider]
    menus: Mapping[str, tuple[str, Mapping[str, Any]]]
    switches: Mapping[str, str]
    presets: Mapping[str, Preset]
    initial: Callable[[Any], Any]
    advance: Callable[[Any, Any, float], Any]
    frame: Callable[[Any, Any], Any]
    drag: Callable[[Any, Any, Pointer], Any] | None = field(default=None)


class Panel(ipywidgets.VBox):
    """Picture, controls and numbers of a simulation. It starts paused.

    Every change of a control starts the experiment anew, so the picture always belongs to the
    settings beside it. Space plays and pauses, R resets, while the picture has the focus.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.controls = model.controls
        self.state = model.initial(self.controls)
        # Callbacks may come from another thread than cells: JupyterLab sends them to a subshell.
        self._lock = threading.RLock()
        self._setting = False
        self._task: asyncio.Task[None] | None = None
        self.canvas = Canvas(model.frame(self.state, self.controls))
        self.canvas.on_key([" ", "r", "R"], lambda key: self._key(key.key))
        if model.drag is not None:
            self.canvas.on_pointer(self._pointer)
        self.inputs = self._make_inputs()
        self._preset = ipywidgets.Dropdown(
            options=list(model.presets), description="Preset", **_style("330px")
        )
        self._note = ipywidgets.HTML()
        self._play = ipywidgets.Button(
            description="Play", icon="play", button_style="primary", layout={"width": "104px"}
        )
        self._reset = ipywidgets.Button(description="Reset", icon="undo", layout={"width": "104px"})
        self._play.on_click(lambda _: self.pause() if self.playing else self.play())
        self._reset.on_click(lambda _: self.reset())
        self._preset.observe(lambda change: self.choose(change["new"]), "value")
        buttons = ipywidgets.HBox([self._play, self._reset])
        side = ipywidgets.VBox(
            [buttons, self._preset, self._note, *self.inputs.values()],
            layout={"flex": "0 0 346px", "width": "346px"},
        )
        self.canvas.layout = ipywidgets.Layout(flex="1 1 520px", max_width="960px")
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
        self._show_note()
        self._show()

    @property
    def playing(self) -> bool:
        """Whether time runs."""
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
                task.get_loop().call_soon_threadsafe(task.cancel)
            self._play.description, self._play.icon = "Play", "play"
            self._show()

    def reset(self) -> None:
        """Back to the start, with the same settings; if it plays, it goes on playing."""
        with self._lock:
            self.state = self.model.initial(self.controls)
            self._show()

    def advance(self, seconds: float) -> None:
        """Let simulated time pass at once."""
        with self._lock:
            self.state = self.model.advance(self.state, self.controls, seconds)
            self._show()

    def set(self, **values: Any) -> None:
        """Set fields of the controls, and start anew.

        Raises:
            ValueError: a value is not allowed.
        """
        with self._lock:
            self.controls = replace(self.controls, **values)
            self._setting = True  # the inputs follow; they must not answer
            try:
                for name, widget in self.inputs.items():
                    widget.value = getattr(self.controls, name)
            finally:
                self._setting = False
            self.reset()

    def choose(self, preset: str) -> None:
        """Take the controls of a preset and start anew."""
        with self._lock:
            if preset not in self.model.presets:
                raise ValueError(f"preset is {preset!r}, allowed is {list(self.model.presets)}")
            self._preset.value = preset
            chosen = self.model.presets[preset].controls
            self.set(**{name: getattr(chosen, name) for name in vars(chosen)})
            self._show_note()

    def close(self) -> None:
        """Stop time and remove the panel from the page."""
        self.pause()
        super().close()

    def _make_inputs(self) -> dict[str, Any]:
        inputs: dict[str, Any] = {}
        for name, slider in self.model.sliders.items():
            label = f"{slider.label} [{slider.unit}]" if slider.unit else slider.label
            inputs[name] = ipywidgets.FloatSlider(
                value=getattr(self.controls, name), min=slider.low, max=slider.high,
                step=slider.step, readout_format=slider.form, description=label,
                **_style("330px"),
            )  # fmt: skip
        for name, (label, options) in self.model.menus.items():
            inputs[name] = ipywidgets.Dropdown(
                options=list(options.items()), value=getattr(self.controls, name),
                description=label, **_style("330px"),
            )  # fmt: skip
        for name, label in self.model.switches.items():
            inputs[name] = ipywidgets.Checkbox(
                value=getattr(self.controls, name), description=label, indent=False,
                layout={"width": "330px"},
            )  # fmt: skip
        for name, widget in inputs.items():
            widget.observe(lambda change, name=name: self._changed(name, change["new"]), "value")
        return inputs

    def _changed(self, name: str, value: Any) -> None:
        if not self._setting:
            with self._lock:
                self.controls = replace(self.controls, **{name: value})
                self.reset()

    def _pointer(self, pointer: Pointer) -> None:
        with self._lock:
            if self.model.drag is not None:
                self.controls = self.model.drag(self.controls, self.state, pointer)
                self.reset()

    def _key(self, key: str) -> None:
        if key in ("r", "R"):
            self.reset()
        elif self.playing:
            self.pause()
        else:
            self.play()

    def _show(self) -> None:
        self.canvas.show(self.model.frame(self.state, self.controls))

    def _show_note(self) -> None:
        note = self.model.presets[self._preset.value].note
        self._note.value = (
            '<div style="width:322px;line-height:1.35;font-size:13px;white-space:normal">'
            f"{html.escape(note)}</div>"
        )

    async def _run(self) -> None:
        """Advance by the time that has passed and show; wait while nobody looks."""
        before = time.monotonic()
        while True:
            await asyncio.sleep(max(0.002, before + 1.0 / _PICTURES_PER_SECOND - time.monotonic()))
            now = time.monotonic()
            passed, before = min(now - before, _LONGEST_ADVANCE), now
            with self._lock:
                if self._task is not asyncio.current_task() or self.comm is None:
                    return
                if self.canvas.watched:
                    self.state = self.model.advance(self.state, self.controls, passed)
                    self._show()

    def __repr__(self) -> str:
        return self.canvas.frame.text

    def _repr_mimebundle_(self, **_options: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        return bundle(self, self.canvas.frame)


def _style(width: str) -> dict[str, Any]:
    return {"style": {"description_width": "118px"}, "layout": {"width": width}}
