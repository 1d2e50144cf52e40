"""The drill autograder: exercises, a grader in a process of its own, and the command `drills`.

Importing this package is light: what is heavy is imported by the function that needs it.
"""
