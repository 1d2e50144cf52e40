"""Robotics Simulation & Software: the table of contents.

Importing this package imports no chapter: `from course import rigid_body` brings in one chapter and
what it needs.
"""

from dataclasses import dataclass

PREREQUISITES = (
    "Linear algebra and some Python. Later chapters also use derivatives, eigenvalues, "
    "differential equations and probability; each chapter says at its top what it needs."
)

# The five sides from which every chapter looks at its subject.
DIMENSIONS = ("concept", "design", "code", "debug", "frontier")


@dataclass(frozen=True)
class Chapter:
    """One chapter of the course.

    Attributes:
        number: its place in the course, from 0.
        topic: its name in every room of the course, such as "rigid_body".
        title: its title, that of its page without the number.
        question: what it answers, in one line.
        simulation: title of its interactive simulation.
        ready: whether its module, notebook and simulation are written.
    """

    number: int
    topic: str
    title: str
    question: str
    simulation: str
    ready: bool = False

    @property
    def module(self) -> str:
        """Import path of the chapter's code."""
        return f"course.{self.topic}"

    @property
    def notebook(self) -> str:
        """The chapter's notebook, relative to the project's folder."""
        return f"notebooks/{self.number:02d}_{self.topic}.ipynb"

    @property
    def simulation_module(self) -> str:
        """Import path of the chapter's simulation."""
        return f"course.simulations.{self.topic}"


CHAPTERS = (
    Chapter(
        0,
        "role",
        "The role",
        "Which parts make up a robot's software, and how fast does each have to answer?",
        "The stack as a graph",
        ready=True,
    ),
    Chapter(
        1,
        "rigid_body",
        "Rigid bodies",
        "How does a body move, and how far can the computed motion be trusted?",
        "A box that bounces and tumbles",
        ready=True,
    ),
    Chapter(
        2,
        "contact",
        "Contact and friction",
        "When do two bodies touch, and what do they do to each other?",
        "Two shapes to push together",
        ready=True,
    ),
    Chapter(
        3,
        "platforms",
        "Simulation platforms",
        "Which simulator for which job, and why do they disagree?",
        "The same scene, side by side",
        ready=True,
    ),
    Chapter(
        4,
        "kinematics",
        "Kinematics and dynamics of arms",
        "Where is the hand, and which joint motion brings it somewhere else?",
        "A two-link arm that follows the pointer",
        ready=True,
    ),
    Chapter(
        5,
        "planning",
        "Motion planning",
        "How does a robot get from here to there without hitting anything?",
        "A tree that grows around obstacles",
        ready=True,
    ),
    Chapter(
        6,
        "control",
        "Control",
        "Which command makes the joint do what the plan says?",
        "A joint that tracks a step",
        ready=True,
    ),
    Chapter(
        7,
        "perception",
        "Perception",
        "From a depth image to the position and orientation of an object: how, and how well?",
        "A point cloud of a table, step by step",
        ready=True,
    ),
    Chapter(
        8,
        "sim_to_real",
        "From simulation to the real robot",
        "What differs between the two, and how is it measured and bridged?",
        "A simulated arm beside its imperfect twin",
        ready=True,
    ),
    Chapter(
        9,
        "learning",
        "Robot learning",
        "When does a learned policy beat a written one, and what does it cost to train?",
        "A policy that learns to reach",
        ready=True,
    ),
    Chapter(
        10,
        "middleware",
        "Middleware and real time",
        "How do the parts talk to each other, and what happens when a message is late?",
        "A graph of nodes and topics",
        ready=True,
    ),
    Chapter(
        11,
        "pipeline",
        "The whole pipeline",
        "Perception, planning, control and physics together: which stage causes which error, and "
        "when do errors cancel?",
        "An arm that finds its target and reaches for it",
        ready=True,
    ),
    Chapter(
        12,
        "interview",
        "The interview",
        "What is asked, and what does a good answer contain?",
        "Mock interview questions against a timer",
        ready=True,
    ),
)
