"""Tables 1 and 2 of the paper on harmonic navigation of several wheelchairs: mean delay of a task, by persons.

The captions are exchanged in the paper; here HUMANS_FIRST is its Table 1 and FLEXIBLE its Table 2, as its text has them.
"""

from __future__ import annotations

PERSONS = (2, 7, 12, 17, 22)

HUMANS_FIRST = {
    "Rectangle": (1.246, 3.289, 5.065, 7.774, 24.222),
    "I": (2.150, 6.367, 12.542, 25.822, 50.063),
    "T": (2.429, 8.713, 29.179, 68.780, 74.190),
    "3tie": (1.408, 4.736, 9.834, 23.590, 70.953),
    "2bconR": (1.744, 6.375, 14.667, 38.802, 110.166),
    "4cross": (1.116, 3.371, 6.856, 13.204, 22.601),
    "9cube": (0.593, 2.028, 3.769, 6.503, 10.201),
    "2d-grid": (0.381, 1.622, 1.610, 2.519, 3.397),
}

FLEXIBLE = {
    "Rectangle": (0.964, 2.219, 3.433, 5.103, 12.797),
    "I": (1.575, 4.097, 7.742, 12.985, 20.447),
    "T": (2.198, 6.622, 17.481, 28.160, 20.588),
    "3tie": (1.069, 3.125, 6.561, 13.265, 24.732),
    "2bconR": (1.266, 4.234, 8.627, 17.224, 32.163),
    "4cross": (0.835, 2.194, 4.415, 7.574, 11.478),
    "9cube": (0.470, 1.374, 2.653, 4.037, 6.203),
    "2d-grid": (0.312, 1.097, 1.139, 1.621, 2.239),
}
