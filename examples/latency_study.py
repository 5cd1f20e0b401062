"""A study of latency: the error of the force on a hand, compared with a real wall, against latency.

Start it:

    python examples/latency_study.py

A simulated hand presses on three walls. The first is a spring and damper displayed by a motor: for each
latency the best on average over 0.1, 0.25, 0.5 and 1 m/s, as in `proximity figures error-latency`. The second
is a contact drum that adds an old distance to the present position of the finger ("naive"). The third adds
it to the position at the instant of the measurement ("time-stamped", as in this project). The
models are those of `proximity simulate`. Change LATENCIES or SPEED.

It prints a table of force errors in percent: the rms of the difference from the force of a real wall over
the rms of that force. It writes latency.csv and latency.png into the folder in which it is started. It
needs: pip install matplotlib
"""

import matplotlib.pyplot as plt
import numpy as np

from proximity.decaff.glove.glove import Glove
from proximity.lab.simulation.devices import Decaff, Hand
from proximity.lab.simulation.sweeps import best_coupled_wall, coupled_row, drum_row, with_latency
from proximity.lab.simulation.target_policies import Target

LATENCIES = 1e-3 * np.array([0.3, 1.0, 3.0, 10.0, 30.0])  # s
SPEED = 0.1  # m/s, of the finger when it touches
RATE = 1000.0  # Hz, of forces and of distances
DRUMS = {"drum, naive": Target.NAIVE, "drum, time-stamped": Target.TIME_STAMPED}


def study(hand, glove):
    """Return the force error of each wall at each latency, in percent."""
    errors = {"spring and damper": [], **{name: [] for name in DRUMS}}
    for latency in LATENCIES:
        wall = best_coupled_wall(hand, RATE, latency)
        errors["spring and damper"].append(100.0 * coupled_row(hand, wall, speeds=[SPEED]).errors[0])
        for name, target in DRUMS.items():
            row = drum_row(hand, with_latency(glove, latency, RATE), target, speeds=[SPEED])
            errors[name].append(100.0 * row.errors[0])
    return errors


def main():
    errors = study(Hand(), Decaff.of(Glove()))

    print("latency, ms  " + "  ".join(f"{name:>18}" for name in errors))
    for row, latency in enumerate(LATENCIES):
        print(f"{1e3 * latency:11.1f}  " + "  ".join(f"{each[row]:17.1f}%" for each in errors.values()))

    table = np.column_stack([1e3 * LATENCIES, *errors.values()])
    header = "latency_ms," + ",".join(name.replace(",", "").replace(" ", "_") for name in errors)
    np.savetxt("latency.csv", table, fmt="%.4g", delimiter=",", header=header, comments="")

    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    for (name, each), style in zip(errors.items(), ("s--", "v:", "o-"), strict=True):
        axes.loglog(1e3 * LATENCIES, each, style, label=name)
    axes.set(xlabel="latency [ms]", ylabel="force error [%]", title=f"touched at {SPEED:g} m/s")
    axes.set_xticks(1e3 * LATENCIES, [f"{1e3 * latency:g}" for latency in LATENCIES])
    axes.set_yticks([1, 3, 10, 30, 100, 300], ["1", "3", "10", "30", "100", "300"])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig("latency.png", dpi=120)
    print("wrote latency.csv and latency.png")


if __name__ == "__main__":
    main()
