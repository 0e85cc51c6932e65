"""The paper, whole: what is trained for it, every figure, its claims, and the page that says what holds.

A figure with its sweeps, table and claims is one record (figure.FigureStudy), in a file here and a line in
registry.FIGURES; reproduce trains and measures what figures need, and report makes the page of it.
`python -m studies.paper --help` lists what can be done with them.
"""
