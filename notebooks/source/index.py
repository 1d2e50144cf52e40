# %% [markdown]
# # Robotics Simulation & Software
#
# ![A box that tumbles, bounces and loses energy: the simulation of chapter 1](../docs/film.png)
#
# Build a robot simulator, and the software of the robot that runs in it. The film shows the simulation of
# chapter 1; just below is one that you can move yourself.
#
# <div class="course-doors">
#
# [**Learn the subject**](00_role.ipynb) from chapter 0 on
#
# [**Practise**](../drills/README.md) with graded drills and mock interviews
#
# [**Use the code**](../docs/howto/modules.md) of a chapter in your project
#
# </div>

# %% [markdown]
# ## Move something
#
# Drag the orange dot: the arm follows. Then pull it out of reach.

# %% tags=["live"]
from course.simulations import simulation

simulation("arm")

# %% [markdown]
# The arm takes small steps of inverse kinematics, and near the limit of its reach a careless step becomes very
# large. [Chapter 4](04_kinematics.ipynb) explains why, and what to do about it.
#
# The course goes from the motion of one rigid body to a policy that leaves the simulator for a real machine.
# Most methods are measured, speed against accuracy, and pushed until they fail. Where a library does the same
# job, they are compared with it. {{front.counts}} {{front.hours}}
#
# **What to know first:** {{PREREQUISITES}} [The mathematics you need](../docs/mathematics/README.md) refreshes
# these pieces in half an hour, with pictures and ten short exercises.

# %% [markdown]
# ## Where you are
#
# This list is brought up to date each time you open the course. Run the cell to update it now, and the one
# below it to tick off the sections that you have read.

# %% tags=["home", "nbval-ignore-output"]
from drills.notebook import home, ticks, your_robot

home()

# %% tags=["nbval-ignore-output"]
ticks()

# %% [markdown]
# ## Your robot
#
# Twenty of the exercises are parts of one robot. It finds a part with a depth camera, picks it up, and puts it into
# its slot without touching a post.
#
# ![The arm at the start, at the grip and at the release of one task](../docs/robot.png)
#
# The picture shows one task of the robot with the course's parts. To begin, solve an exercise such as `drills start
# two_link_ik`: your answer then takes the place of the course's part, and [the page of the
# drills](../drills/README.md) explains how you measure what it changes.

# %% tags=["nbval-ignore-output"]
your_robot()

# %% [markdown]
# ## The chapters
#
# {{contents.map_of_chapters}}
#
# Each chapter explains a concept, shows where it sits in a robot's software, opens the code that implements
# it, and shows how it fails and what is new. It ends with exercises and with the questions of an interview.
#
# ## How to
#
# - [Use a chapter's module in your own project](../docs/howto/modules.md)
# - [Put your own method on a work-precision chart](../docs/howto/chart.md)
# - [Write a vector environment of your own](../docs/howto/vector_env.md)
# - [Put your own planner into the robot](../docs/howto/robot_planner.md)
# - [Grade drills in continuous integration](../docs/howto/drills_in_ci.md)
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
# **Key insight.** The one sentence to remember.
#
# </div>
#
# ## On a phone, without Python
#
# <span class="kernel-only">`make site` builds these notebooks as pages in the folder `site/`. They need no
# server and no kernel: open `site/index.html`, or copy the folder to any static host.</span>
# {{contents.moving}}
