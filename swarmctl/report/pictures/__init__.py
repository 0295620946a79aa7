"""Pictures as PNG: the map of a run, shaded as in the paper's Figure 8, and the fronts of routes.

`scene` and `panel` hold what is drawn; `sheet` and `front` draw it with matplotlib, which takes a second to
import: their callers import them when they draw.
"""
