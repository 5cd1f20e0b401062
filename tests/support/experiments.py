"""Small experiments for tests: designs as text, and simulated sessions."""

from importlib.resources import files

from proximity.lab.experiment.observers import Observer
from proximity.lab.experiment.visit import place, read_visit, read_visits, run_visit

SHIPPED = files("proximity.lab.experiment") / "decaff_against_coupled.toml"

SMALL = """
title = "Small"
seed = 7
participants = 4
consent = "You press."
welcome = "Press."
goodbye = "Thanks."

[limits]
force = 4.0

[[conditions]]
name = "real"
wall = "real"

[[conditions]]
name = "late"
wall = "coupled"
latency = 0.003
stiffness = 1500.0
damping = 2.0
threshold = 0.3
correct = 0.9

[[tasks]]
name = "stiffness"
kind = "stiffer"
trials = 8
levels = [0.1, 0.2, 0.4, 0.8]
stiffness = 200.0
catch = 1
practice = 1

[[tasks]]
name = "which"
kind = "real"
trials = 4
"""


def write_design(folder, text=SMALL):
    """Write a design; return its path."""
    path = folder / "design.toml"
    path.write_text(text, encoding="utf-8")
    return path


def simulate(design, folder, name, make=Observer):
    """Run the remaining trials of a simulated participant's session; return its rows."""
    slot = place(design, read_visits(design, folder), name, Observer.name, folder)[0]
    observer = make(design, slot)
    run_visit(design, folder, name, observer, observer)
    return read_visit(design, folder / f"{name}.csv")
