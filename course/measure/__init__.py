"""How the course measures: work against precision, stability limits, scenes.

Generic: the functions here get callables and know nothing of a chapter. They need NumPy;
matplotlib is imported when something is drawn.
"""
