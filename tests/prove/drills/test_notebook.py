"""`check` in a real kernel: what takes long, and what would do harm."""

from __future__ import annotations

from tests.drills.test_notebook import RIGHT, Kernel, kernel

__all__ = ["kernel"]


def test_an_answer_that_would_end_the_kernel_does_not(kernel: Kernel) -> None:
    kernel.run(
        "import os\ndef verlet_step(q, v, a, acceleration, dt):\n    os.kill(os.getppid(), 9)\n"
        "    os._exit(0)"
    )
    assert kernel.run("check(verlet_step)")["text/plain"].startswith("NOT RIGHT")
    assert kernel.run("print(1 + 1)")["stream"] == "2\n"


def test_a_chart_is_a_picture_and_a_table(kernel: Kernel) -> None:
    kernel.run(RIGHT)
    shown = kernel.run("check(verlet_step).chart()")
    assert "yours" in shown["text/plain"] and len(shown["image/png"]) > 1000
    kernel.run("def verlet_step(q, v, a, acceleration, dt):\n    return q, v, a")
    assert "Only a right answer" in kernel.run("check(verlet_step).chart()")["text/plain"]


def test_a_file_beside_the_notebook_does_not_shadow_a_package(kernel: Kernel) -> None:
    shadow = kernel.work.parent / "click.py"
    shadow.write_text("raise RuntimeError('the wrong one')")
    try:
        kernel.run(RIGHT)
        assert kernel.run("check(verlet_step)")["text/plain"].startswith("RIGHT")
    finally:
        shadow.unlink()
