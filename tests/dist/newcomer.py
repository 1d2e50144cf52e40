"""What somebody does who has the package and its dependencies: run where it is installed.

`python newcomer.py core` is without any extra, `python newcomer.py lab` has that one as well. Each
step says what it saw; the last line holds all of it as JSON.
"""

import ast
import importlib
import json
import pkgutil
import sys
import warnings
from pathlib import Path
from typing import Any

from click.testing import CliRunner

from course import CHAPTERS, charts, derivations, libraries
from drills import cards
from drills.cli import cli

FOUND: dict[str, Any] = {}


def drills(*arguments: str, text: str = "") -> list[Any]:
    """Exit code, and what was written to the two streams."""
    done = CliRunner().invoke(cli, arguments, input=text, prog_name="drills")
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    return [done.exit_code, done.stdout, done.stderr]


def refusal(call: Any) -> str:
    """What is said where an extra is missing; "" if nothing is."""
    try:
        call()
    except ImportError as error:
        return str(error)
    return ""


def core() -> None:
    import course
    import drills as command
    import solutions

    FOUND["places"] = [str(m.__path__[0]) for m in (course, command, solutions)]
    # Every module, and so every chapter, simulation, chart, claim and answer.
    names = [
        result.name
        for room in (course, command, solutions)
        for result in pkgutil.walk_packages(room.__path__, f"{room.__name__}.")
        if not result.name.endswith((".__main__", ".sandbox.child"))  # are run, not imported
        and not result.name.startswith("course.site")
    ]
    FOUND["unimportable"] = {n: message for n in names if (message := refusal(lambda n=n: load(n)))}
    FOUND["imported"] = sorted(sys.modules)

    texts = {path.stem: charts.read(path.stem) for path in charts.FOLDER.glob("*.txt")}
    drawn = {path.stem: charts.stored(path.stem) for path in charts.FOLDER.glob("*.json")}
    FOUND["charts"] = {name: len(text) for name, text in texts.items()}
    FOUND["drawn"] = {name: len(panels) for name, panels in drawn.items()}
    FOUND["registered"] = sorted(charts.CHARTS)

    FOUND["claims"] = {c.number: len(derivations.claims(c.number)) for c in CHAPTERS}
    FOUND["claim"] = dict(derivations.run("chain_age").finding.figures)
    name = "semi_implicit_limit"
    right, wrong = (derivations.answer(name, text) for text in ("sqrt(4 m/k)", "sqrt(2 m/k)"))
    FOUND["formula"] = [right.correct, wrong.correct, wrong.message]

    FOUND["list"] = drills("list")
    FOUND["start"] = drills("start", "verlet")
    FOUND["starter"] = drills("check", "verlet")
    Path("work/verlet.py").write_text("def verlet_step(q, v, a, acceleration, dt):\n    return q\n")
    FOUND["wrong"] = drills("check", "verlet")
    FOUND["hint"] = drills("hint", "verlet")
    Path("work/verlet.py").write_text(cards.card("verlet").solution_text())
    FOUND["right"] = drills("check", "verlet")
    FOUND["review"] = drills("review", text="\n3\n")
    requested = ("interview", "--kind", "debugging", "--chapters", "3", "--seed", "1")
    FOUND["interview"] = drills(*requested, text="\n".join([".", *"1" * 9, ".", "1", "1", "1", ""]))
    FOUND["chapter"] = {c.topic: drills("start", str(c.number)) for c in CHAPTERS}

    from course.oracles import (
        coal,
        cyclonedds,
        drake,
        mink,
        ompl,
        open3d,
        opencv,
        pink,
        pinocchio,
        pybullet,
        sb3,
        small_gicp,
        vamp,
        zenoh,
    )
    from course.oracles.mujoco import sysid

    needing = {
        "torch": libraries.pytorch,
        "pin": pinocchio._pinocchio, "coal": coal._coal, "ompl": ompl._ompl,
        "open3d": open3d.library, "opencv": opencv.library,
        "small_gicp": small_gicp.library, "vamp": vamp.library, "cyclonedds": cyclonedds.library,
        "zenoh": zenoh.library, "drake": drake.library, "pybullet": pybullet.library,
        "mink": mink.library, "pink": pink.library, "sb3": lambda: sb3.vec_env(None), "sysid": sysid.toolbox,
    }
    FOUND["refusals"] = {name: refusal(call) for name, call in needing.items()}


def load(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        importlib.import_module(name)


def lab() -> None:
    FOUND["review"] = drills("review", "--chapters", "0", "--limit", "2", text="\n3\n\n3\n")
    # The copies that were made: what they import is there.
    for path in sorted(Path("work").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        for cell in cells:
            if cell["cell_type"] == "code" and not "".join(cell["source"]).startswith("%"):
                imports: list[ast.stmt] = [
                    node
                    for node in ast.parse("".join(cell["source"])).body
                    if isinstance(node, ast.Import | ast.ImportFrom)
                ]
                exec(compile(ast.Module(imports, []), path.name, "exec"), {})
                FOUND[path.name] = FOUND.get(path.name, 0) + len(imports)


if __name__ == "__main__":
    {"core": core, "lab": lab}[sys.argv[1]]()
    print(json.dumps(FOUND))
