"""Curves of a simulated press: positions and forces next to those of the real wall."""

from proximity.lab.figures.style import SAMPLING, Table
from proximity.lab.simulation.closed_loop import Response
from proximity.lab.simulation.simulated_press import Simulation, Wall


def numbers(simulation: Simulation) -> Table:
    """Return a press every 0.1 ms or so, and the same on a real wall."""
    return curves(simulation.response, simulation.real, has_drum=simulation.setup.wall == Wall.DECAFF)


def curves(response: Response, real: Response, *, has_drum: bool, ideal: Response | None = None) -> Table:
    """Return a press every 0.1 ms or so, in whole steps, with another at the same instants."""
    stride = max(round(SAMPLING / response.step), 1)
    every = slice(response.zero % stride, None, stride)  # the contact among them
    times = response.times[every]
    columns = {
        "time_s": times,
        "intent_m": response.press.at(times).position,
        "finger_m": response.finger[every],
        "link_m": response.link[every],
        "force_N": response.force[every],
        "real_finger_m": real.finger[every],
        "real_force_N": real.force[every],
    }
    if has_drum:
        columns |= {"drum_m": response.drum[every], "drum_force_N": response.contact[every]}
    if ideal is not None:
        columns["ideal_force_N"] = ideal.force[every]
    return Table(columns)
