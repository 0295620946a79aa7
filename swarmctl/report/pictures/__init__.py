"""Pictures as PNG: the map of a run, shaded as in the paper's Figure 8, and the fronts of routes.

`scene` and `panel` hold the content; `sheet` and `front` draw with matplotlib. Matplotlib takes a second to
import, so callers import `sheet` and `front` only to draw.
"""
