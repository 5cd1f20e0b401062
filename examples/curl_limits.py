"""Force gloves of any make: the bend at which each finger touches, as curl limits of an OpenXR runtime.

Start it on Linux, together with a service that receives poses of a glove or with finger paths.
The runtime must have XR_MNDX_force_feedback_curl and drive the glove:

    python -m pip install "cad-proximity[openxr]"
    python examples/curl_limits.py shm://proximity

The extension takes a number per finger: 0 lets it curl freely, 1 keeps it extended, 0.4 stops it at bend 0.6.
The value is 0 for a late or stale frame, without a known touch, and at the end, as runtimes keep the last
one. Fingers 0 to 4 are the left hand's, thumb first. It prints all ten when a finger is limited or released.
"""

import ctypes
import sys
import time
from contextlib import ExitStack

import numpy as np
import xr

import proximity

EXTENSIONS = ["XR_EXT_hand_tracking", "XR_MND_headless", "XR_MNDX_force_feedback_curl"]
CURLS = list(xr.ForceFeedbackCurlLocationMNDX)[:5]  # thumb to little finger
SURE = proximity.ContactFlag.TRACKED | proximity.ContactFlag.CONTACT_FOUND


def curl_limits(reading, before):
    """Return the limits of ten fingers; that of a touching finger is not released below *before*."""
    limits = np.zeros(10)
    if reading.is_valid:  # neither LATE nor STALE
        contacts, before = reading.contacts[:10], before[: len(reading.contacts)]
        found = np.nan_to_num(np.clip(1.0 - contacts["contact_bend"], 0.0, 1.0))
        found = np.where(contacts["signed_distance"] > 0.0, found, np.maximum(found, before))
        limits[: len(found)] = np.where(contacts["flags"] & SURE == SURE, found, 0.0)
    return limits


def apply(trackers, limits):
    for tracker, hand in zip(trackers, limits.reshape(2, 5), strict=True):
        each = list(map(xr.ForceFeedbackCurlApplyLocationMNDX, CURLS, hand))
        xr.apply_force_feedback_curl_mndx(tracker, xr.ForceFeedbackCurlApplyLocationsMNDX(locations=each))


def goes_on(instance, session):
    """Begin or end the session as the runtime requests; return whether it continues."""
    try:
        event = xr.poll_event(instance)
    except xr.EventUnavailable:
        return True
    if xr.StructureType(event.type) != xr.StructureType.EVENT_DATA_SESSION_STATE_CHANGED:
        return True
    state = ctypes.cast(ctypes.byref(event), ctypes.POINTER(xr.EventDataSessionStateChanged)).contents.state
    if state == xr.SessionState.READY:
        xr.begin_session(session, xr.SessionBeginInfo())
    elif state == xr.SessionState.STOPPING:
        xr.end_session(session)
    return state not in (xr.SessionState.EXITING, xr.SessionState.LOSS_PENDING)


def main(address):
    limits = np.zeros(10)
    with proximity.open_subscriber(address) as frames, ExitStack() as opened:
        instance = xr.create_instance(xr.InstanceCreateInfo(enabled_extension_names=EXTENSIONS))
        opened.callback(xr.destroy_instance, instance)  # with all its objects
        session = xr.create_session(instance, xr.SessionCreateInfo(system_id=xr.get_system(instance)))
        hands = map(xr.HandTrackerCreateInfoEXT, (xr.HandEXT.LEFT, xr.HandEXT.RIGHT))
        trackers = [xr.create_hand_tracker_ext(session, hand) for hand in hands]
        opened.callback(apply, trackers, np.zeros(10))
        while goes_on(instance, session):
            before, limits = limits, curl_limits(frames.read(), limits)
            apply(trackers, limits)
            if ((limits > 0.0) != (before > 0.0)).any():
                print(*(f"{limit:.2f}" for limit in limits))
            time.sleep(0.005)


if __name__ == "__main__":
    main(sys.argv[1])
