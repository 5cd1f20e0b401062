"""Small experiments for tests: designs as text, and simulated sessions."""

from importlib.resources import files

from proximity.lab.experiment.observers import Observer
from proximity.lab.experiment.session import run_visit

SHIPPED = files("proximity.lab.experiment") / "decaff_against_coupled.toml"

SMALL = """
title = "Small"
seed = 7
participants = 2
consent = "You press."
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

[[questions]]
key = "hours"
text = "How many?"
range = [0, 10]

[[questions]]
key = "hand"
text = "Which hand?"
choices = ["right", "left"]
when = "after"
"""


def write_design(folder, text=SMALL):
    """Write a design, and return its path."""
    path = folder / "design.toml"
    path.write_text(text, encoding="utf-8")
    return path


def simulate(dataset, name, make=Observer, monitor=None):
    """Do what is left of a simulated participant's session."""
    observer = make(dataset.design, dataset.register(name, Observer.name))
    run_visit(dataset, name, observer, observer, monitor)
