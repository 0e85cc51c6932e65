"""The paper, whole: what is trained for it, every figure, its claims, and the page that says what holds.

A figure with its sweeps and table is one record (figure.FigureStudy), in a file here and a line in registry.FIGURES.
Claims are lines of claims.CLAIMS, and what the page says in words is in the folder `text`. reproduce trains and
measures, and report makes the page of it. `python -m studies.paper --help` lists what can be done with them.
"""
