# %% [markdown]
# *For anyone who wants to know how far a simulated number can be trusted, and for interviews about it*
#
# # Robotics Simulation & Software
#
# You learn to build the simulator and the software of the robot that runs in it: from the motion of
# one rigid body to a policy that leaves the simulator for the real machine. Every number in the
# course is computed in front of you. Every method is measured, speed against accuracy, beside the
# library that professionals use for the same job, and pushed until it fails.
#
# **What to know first:** {{PREREQUISITES}}

# %% [markdown]
# ## Where you are
#
# Written anew each time you open the course; run the cell to see it as it is now, and the one below it to
# tick off what you have read.

# %% tags=["home", "nbval-ignore-output"]
from drills.notebook import home, ticks

home()

# %% tags=["nbval-ignore-output"]
ticks()

# %% [markdown]
# {{contents.figures}}
#
# ## The chapters
#
# {{contents.map_of_chapters}}
#
# ## Five sides of every subject
#
# | | what you find there |
# |---|---|
# | **Concept** | the idea from first principles, short enough for a whiteboard |
# | **Design** | where it sits in the system, what flows in and out and how fast, the trade-offs |
# | **Code** | the reference implementation, shown from the module that the tests run |
# | **Debug** | how it fails: the symptom, its cause, a test for it, the repair |
# | **Frontier** | what is new, with year and source, and a small part of it to run |
#
# A chapter has one simulation to move, one chart of speed against accuracy, one map of where its
# methods stop working, and exercises. Work from top to bottom, or open a section by its heading in
# the side panel.
#
# ## Boxes in the text
#
# <div class="alert alert-block alert-info">
#
# **Interview question.** What an interviewer asks. Answer aloud before you open the answer.
#
# </div>
# <div class="alert alert-block alert-success">
#
# **Interview tip.** How to say it, and what to leave out.
#
# </div>
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** A symptom, and the first thing to look at.
#
# </div>
# <div class="alert alert-block alert-warning">
#
# **Key insight.** The one sentence to keep.
#
# </div>
#
# ## Three doors
#
# - **You want to learn the subject.** Open the first chapter that is ready in the table above and
#   <span class="kernel-only">run it (*Run, Run All Cells*, which needs no network), then</span> work
#   through it from top to bottom.
# - **You have an interview soon.** Each chapter ends with the questions and their follow-ups. In a
#   terminal, `.venv/bin/drills` lists coding drills that are graded in a second or two; the exercises of a
#   chapter are graded in its notebook, which shows at its top which of them you have attempted and
#   solved. A checkpoint closes a chapter.
# - **You want the code.** Each chapter is a module that needs neither a notebook nor a display:
#   `from course import rigid_body`. Then `help(rigid_body)` shows what is in it.
#
# ## Without a kernel
#
# `make site` makes pages of these notebooks, the folder `site/`: no server, no kernel, nothing fetched
# from elsewhere. A double click on its `index.html` opens them, and so does every static host that the
# folder is copied to; `python -m http.server -d site` is one. {{contents.moving}}
