"""What a simulation is, and one run of it, without a view.

A module `course.simulations.<topic>` declares a `MODEL`. Its functions take records and a pen,
change them in place, and are in the subset of Python that Numba compiles (no strings, no objects):
the same source runs in a notebook, in a debugger, and compiled. They run as plain Python here; a
loop in them that is too slow for that is a `course.compiled.loop`.

Where the start takes long, `initial` does a part of the work, leaves in the state's field
`remaining` how many portions are left, and each call of `complete` does one of them. A panel shows
what is there and lets the portions follow between pictures; a program waits until all is there.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.check import finite, invalid, one_of
from course.simulations import pen as drawing
from course.simulations.record import Field, Record, menu

# The keys that a model may answer, by their number; named as in a browser.
KEYS = ("ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "+", "-")


@dataclass(frozen=True)
class Preset:
    """Controls worth looking at (what differs from the defaults), and what to look for.

    Attributes:
        values: what differs from the defaults.
        note: what happens, and what to try.
        recorded: what happens, for a page that can only play a recording; the note if empty.
    """

    values: Mapping[str, Any]
    note: str
    recorded: str = ""


@dataclass(frozen=True)
class Model:
    """A simulation.

    Attributes:
        title: its name.
        paper: what its pictures are drawn on.
        controls: what can be set; the limits hold for whatever the functions are handed.
        state: what it keeps; before `initial` every field has its default.
        presets: by name; the first one is what the panel starts with.
        initial: (controls, state): the state at time zero.
        advance: (state, controls, seconds): let time pass.
        frame: (pen, state, controls): draw the picture and the numbers.
        drag: (controls, state, x, y), if something can be moved: the pointer is at (x, y) in units
            of the window.
        grab: (controls, state, x, y), if a drag has to know where it began: the pointer goes down.
        press: (controls, state, key): the key with this number in `KEYS` is pressed.
        live_drag: drags and keys act on the running state; else the experiment restarts from
            what they did to the controls.
        recorded: the pictures were computed beforehand, as a library had to come along.
        aside: words that only a running panel shows, such as milliseconds, and no saved page.
        readouts: what each number below the picture means, by its name: a tooltip.
        complete: (controls, state), if computing takes long: do one of the portions that `initial`,
            `drag`, `press` or `advance` has left, and set the state's field `remaining`.
        upright: whether something is dragged up or down; where it is not, a finger that moves up or
            down on the picture scrolls the page.
    """

    title: str
    paper: drawing.Paper
    controls: Record
    state: Record
    presets: Mapping[str, Preset]
    initial: Callable[[Any, Any], None]
    advance: Callable[[Any, Any, float], None]
    frame: Callable[[Any, Any, Any], None]
    drag: Callable[[Any, Any, float, float], None] | None = None
    grab: Callable[[Any, Any, float, float], None] | None = None
    press: Callable[[Any, Any, int], None] | None = None
    live_drag: bool = False
    recorded: bool = field(default=False)
    aside: Callable[[], str] | None = None
    readouts: Mapping[str, str] = field(default_factory=dict)
    upright: bool = True
    complete: Callable[[Any, Any], None] | None = None

    def __post_init__(self) -> None:
        if self.complete is not None and "remaining" not in self.state.fields:
            raise invalid("state", list(self.state.fields), "with a field `remaining`")


class Experiment:
    """One run of a model: its controls, its state and the pen that draws it.

    Attributes:
        in_portions: whether what takes long waits for `complete`. Otherwise it is done at once.
    """

    def __init__(self, model: Model, **values: Any) -> None:
        self.model = model
        self.in_portions = False
        self.controls = model.controls.new(**values)
        self.state = model.state.new()
        self._pen = model.paper.pen()
        self.start()

    def start(self) -> None:
        """Begin anew, with the same controls."""
        # The state is a function of the controls and of time: nothing of an earlier run remains.
        self.model.state.reset(self.state)
        self.model.initial(self.controls, self.state)
        self._finish()

    @property
    def remaining(self) -> int:
        """How many portions `complete` has still to do."""
        return 0 if self.model.complete is None else int(self.state["remaining"])

    def complete(self) -> bool:
        """Do one portion of what takes long; return whether any is left."""
        if self.model.complete is not None and self.remaining:
            self.model.complete(self.controls, self.state)
        return self.remaining > 0

    def _finish(self) -> None:
        while not self.in_portions and self.complete():
            pass

    def set(self, **values: Any) -> None:
        """Set controls; begin anew unless all of them act on the running state.

        Raises:
            ValueError: a value is not allowed; then nothing is changed.
        """
        # One control that is not live restarts the experiment, since the picture must belong to its
        # settings.
        self.model.controls.set(self.controls, **values)
        if not all(self.model.controls.fields[name].live for name in values):
            self.start()

    def choose(self, preset: str) -> None:
        """Take the controls of a preset and begin anew."""
        known = self.model.presets
        chosen = self.model.controls.new(**known[one_of("preset", preset, known)].values)
        for name in self.model.controls.fields:
            self.controls[name] = chosen[name]
        self.start()

    def advance(self, seconds: float) -> None:
        """Let simulated time pass.

        Raises:
            ValueError: seconds is negative or not finite.
        """
        self.model.advance(self.state, self.controls, finite("seconds", seconds, 0.0))
        self._finish()

    def drag(self, x: float, y: float) -> None:
        """Handle a drag: the pointer is at (x, y) in units of the window.

        Without a `drag` nothing happens.
        """
        if self.model.drag is not None:
            self.model.drag(self.controls, self.state, x, y)
            # Controls that a drag changed take effect from the start, unless the model acts on the
            # running state.
            if not self.model.live_drag:
                self.start()
            self._finish()

    def grab(self, x: float, y: float) -> None:
        """Handle a press of the pointer.

        The pointer goes down at (x, y), where a drag may begin.
        """
        if self.model.grab is not None:
            self.model.grab(self.controls, self.state, x, y)

    def press(self, key: str) -> None:
        """Handle a key: a key of `KEYS` is pressed; without a `press` nothing happens."""
        if self.model.press is not None:
            self.model.press(self.controls, self.state, KEYS.index(key))
            if not self.model.live_drag:
                self.start()
            self._finish()

    def take(self, controls: bytes, state: bytes) -> None:
        """Go on from where another run of the model is: its records, byte by byte.

        Raises:
            ValueError: they are not such records; then nothing is changed.
        """
        # Both records are checked before either is copied, so that a bad message changes nothing.
        taken = self.model.controls.read(controls), self.model.state.read(state)
        for own, other in zip((self.controls, self.state), taken, strict=True):
            for name in own.dtype.names:
                own[name] = other[name]
        self._finish()

    def later(self, seconds: float) -> drawing.Picture:
        """Return the picture so long after the start, with the same controls.

        This run stays as it is.
        """
        other = Experiment(self.model)
        for name in self.model.controls.fields:
            other.controls[name] = self.controls[name]
        other.start()
        other.advance(seconds)
        return other.picture()

    def picture(self) -> drawing.Picture:
        """Return the picture now."""
        drawing.clear(self._pen)
        self.model.frame(self._pen, self.state, self.controls)
        return drawing.picture(self.model.paper, self._pen)


def recorded(
    title: str,
    paper: drawing.Paper,
    presets: Mapping[str, tuple[str, Sequence[NDArray[np.float64]]]],
    seconds: float,
) -> Model:
    """Return a model that shows pictures drawn beforehand, for what a library computes.

    Args:
        title: its name.
        paper: what the pictures were drawn on.
        presets: a note, and `Picture.data` of each picture in turn, by name.
        seconds: between two pictures.
    """
    names = tuple(presets)

    def initial(controls: Any, state: Any) -> None:
        state["time"] = 0.0

    def advance(state: Any, controls: Any, passed: float) -> None:
        state["time"] += passed

    def frame(pen: Any, state: Any, controls: Any) -> None:
        pictures = presets[names[controls["recording"]]][1]
        # The last picture stays once the recording is over.
        drawing.copy(pen, pictures[min(int(state["time"] / seconds), len(pictures) - 1)])

    return Model(
        title,
        paper,
        Record(recording=menu("Recording", names)),
        Record(time=Field(0.0, unit="s")),
        {name: Preset({"recording": name}, note) for name, (note, _) in presets.items()},
        initial,
        advance,
        frame,
        recorded=True,
    )
