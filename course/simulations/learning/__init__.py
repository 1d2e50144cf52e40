"""Chapter 9's simulations: a point that learns while one watches, and heads that clone two ways."""

from course.simulations.learning.point import MODEL

__all__ = ["MODEL"]
