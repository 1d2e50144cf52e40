"""Worked answers of the notebooks' graded exercises, one module per chapter.

They are what a learner is shown after a pass or on giving up: plain NumPy, of a size that fits into
an interview, each complete by itself. Nothing here imports the course.
"""
