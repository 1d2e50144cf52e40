"""Seven jobs as needs on the stored tables, and what `choose` answers."""

from collections.abc import Mapping

from course.charts.platforms.record import READER
from course.charts.platforms.table import (
    ENGINES,
    ON_THE_WAY,
    TABLE,
    Rows,
    costs,
    errors,
    in_the_air,
    path_errors,
    stored_rows,
)
from course.platforms.choose import UNKNOWN, Fact, Need, choose
from course.platforms.models import honesty


def facts(rows: Rows | None = None, paths: Rows | None = None) -> dict[str, dict[str, Fact]]:
    """Return what was measured of each engine with fair settings at 1 ms.

    Error and cost of every scene; of some, the largest error on the way and the share of the time
    in the air as well.

    Beside them are the share of faulty models that it rejects or warns about, whether one
    `pip install` brings it, which of them have no physics on a GPU, and the rows that some job
    needs and nobody measured here.

    Args:
        rows: of `platforms_table`; None for the stored ones.
        paths: of `platform_paths`, likewise.
    """
    rows = stored_rows() if rows is None else rows
    paths = stored_rows("platform_paths") if paths is None else paths
    read = stored_rows("platform_readers")
    result: dict[str, dict[str, Fact]] = {}
    for name in ENGINES:
        mine = result[name] = {}
        for scene in TABLE:
            unit = next(row[5] for row in rows if row[0] == scene)
            mine[f"{scene} error"] = Fact(errors(rows, scene)[name], unit)
            mine[f"cost of {scene}"] = Fact(costs(rows, scene)[name])
        for scene in ON_THE_WAY:
            unit = next(row[6] for row in paths if row[0] == scene)
            mine[f"{scene} error on the way"] = Fact(path_errors(paths, scene)[name], unit)
            mine[f"{scene} in the air"] = Fact(in_the_air(paths, scene)[name])
        verdicts = {row[1]: row[3] for row in read if row[0] == READER.get(name, name)}
        mine["share of faults reported"] = Fact(honesty(verdicts))
        # Our code is part of this course; the three simulators are packages of Python's index.
        mine[PIP.row] = Fact(name != "own code", source="pyproject.toml")
        mine.update(dict.fromkeys(UNMEASURED, UNKNOWN))
        if name in NO_GPU:
            mine[WORLDS.row] = Fact(False, source=NO_GPU[name])
    return result


WORLDS, CAMERAS = Need("thousands of worlds on a GPU"), Need("photorealistic cameras")
IMAGES, PIP = Need("10,000 camera images per second"), Need("installed by one pip install")
CERTIFICATE, ELEMENTS = Need("proof of safety, contacts included"), Need("finite elements")
UNMEASURED = tuple(need.row for need in (WORLDS, CAMERAS, IMAGES, CERTIFICATE, ELEMENTS))
# MuJoCo has two versions for GPUs, MJX and MuJoCo Warp; nobody measured them here.
NO_GPU = {
    "own code": "this course",
    "Drake": "pydrake 1.51: none of its names speaks of a GPU, CUDA or OpenCL",
    "PyBullet": "the claim bullet_on_gpu",
}
HELD = [Need("grasp error", 1e-3, "at most")]
TOUCHING = [
    *HELD,
    Need("brake error on the way", 1e-2, "at most"),
    Need("tower error", 1e-3, "at most"),
]
JOBS: Mapping[str, tuple[list[Need], str]] = {
    "RL training, one world on a CPU": (HELD, "cost of grasp"),
    "RL training, from images": ([*HELD, IMAGES], "cost of grasp"),
    "Manipulation research": (TOUCHING, "cost of tower"),
    "Visual perception": ([CAMERAS], "cost of tower"),
    "Control that is proved safe": ([CERTIFICATE], "cost of tower"),
    "A quick prototype": (
        [PIP, Need("share of faults reported", 0.75, "at least")],
        "cost of tower",
    ),
    "Soft, deformable objects": ([ELEMENTS], "cost of grasp"),
}
DOCUMENTED = {
    CAMERAS.row: "Isaac Sim renders by tracing paths of light, on an NVIDIA GPU (its manual, 2026)",
    IMAGES.row: "Isaac Lab reports 50,000 steps per second for 1,024 carts with a camera each, on "
    "an RTX 4090 (its manual, 2025)",
    CERTIFICATE.row: "Drake has tools with which you can prove that states of a *model* are safe "
    "(its manual, 2026)",
    ELEMENTS.row: "SOFA, an engine for soft bodies, has them (its README, 2024); "
    "PhysX has soft bodies, too (Isaac Lab's manual, 2026)",
}


def decide(job: str, rows: Rows | None = None, paths: Rows | None = None) -> tuple[str, str]:
    """Return the pick for a job, and the rows that decided it.

    Where none could, what is documented.
    """
    needs, by = JOBS[job]
    result = choose(facts(rows, paths), needs, by)
    if result.pick is None:
        row = next(row for row in result.deciding if row in DOCUMENTED)
        return "not measured here", f"{row}: not measured for any of the four. {DOCUMENTED[row]}"
    why = "decided by: " + ", ".join(result.deciding)
    if result.turn:
        why += f". {result.turn}"
    return result.pick, why
