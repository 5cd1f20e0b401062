"""Hands by OpenXR: the fingertips of both hands of a headset, sent to a service as poses.

Start it on Linux, with the headset's runtime running, Monado for example, in two terminals:

    python -m pip install "cad-proximity[openxr,web]"
    proximity serve examples/openxr_hands.toml --web
    python examples/openxr_hands.py shm://openxr/poses
It prints how many fingers are tracked.
"""

import ctypes
import sys
import time
from contextlib import ExitStack

import numpy as np
import xr

import proximity

EXTENSIONS = ["XR_EXT_hand_tracking", "XR_MND_headless", "XR_KHR_convert_timespec_time"]
TIPS, JOINTS = [5, 10, 15, 20, 25], 26  # fingertips, thumb first, among the joints of a hand
SEEN = int(xr.SPACE_LOCATION_POSITION_VALID_BIT | xr.SPACE_LOCATION_POSITION_TRACKED_BIT)


def state_of(instance, session):
    """Begin or end the session as the runtime requests; return its new state, if any."""
    try:
        event = xr.poll_event(instance)
    except xr.EventUnavailable:
        return None
    if xr.StructureType(event.type) != xr.StructureType.EVENT_DATA_SESSION_STATE_CHANGED:
        return None
    state = ctypes.cast(ctypes.byref(event), ctypes.POINTER(xr.EventDataSessionStateChanged)).contents.state
    if state == xr.SessionState.READY:
        xr.begin_session(session, xr.SessionBeginInfo())
    elif state == xr.SessionState.STOPPING:
        xr.end_session(session)
    return state


def fingertips(locate, hand, space, at):
    """Return the fingertips of a hand, (5, 3) m, z up; nan if they are not tracked."""
    joints = (xr.HandJointLocationEXT * JOINTS)()
    found = xr.HandJointLocationsEXT(joint_count=JOINTS, joint_locations=joints)
    where = xr.HandJointsLocateInfoEXT(base_space=space, time=at)
    if (result := xr.check_result(locate(hand, where, ctypes.byref(found)))).is_exception():
        raise result
    tips = [joints[number] for number in TIPS]
    places = [(tip.pose.position.x, -tip.pose.position.z, tip.pose.position.y) for tip in tips]
    return np.where([[found.is_active and tip.location_flags & SEEN == SEEN] for tip in tips], places, np.nan)


def main(address):
    message, state, before = proximity.Message(proximity.POSES, 10), None, None
    message.records["finger"] = range(10)
    message.records["velocity"] = message.records["bend"] = np.nan
    with proximity.open_publisher(address) as poses, ExitStack() as opened:
        instance = xr.create_instance(xr.InstanceCreateInfo(enabled_extension_names=EXTENSIONS))
        opened.callback(xr.destroy_instance, instance)  # with all its objects
        session = xr.create_session(instance, xr.SessionCreateInfo(system_id=xr.get_system(instance)))
        space = xr.create_reference_space(session, xr.ReferenceSpaceCreateInfo(xr.ReferenceSpaceType.LOCAL))
        hands = [xr.create_hand_tracker_ext(session, xr.HandTrackerCreateInfoEXT(of)) for of in xr.HandEXT]
        function = xr.get_instance_proc_addr(instance, "xrLocateHandJointsEXT")
        locate = ctypes.cast(function, xr.functions.PFN_xrLocateHandJointsEXT)
        while state not in (xr.SessionState.EXITING, xr.SessionState.LOSS_PENDING):
            state, now_ns = state_of(instance, session), time.monotonic_ns()
            at = xr.convert_timespec_time_to_time_khr(instance, xr.timespec(*divmod(now_ns, 10**9)))
            tips = np.concatenate([fingertips(locate, hand, space, at) for hand in hands])
            if not np.array_equal(tips, before, equal_nan=True):  # else the same pose
                message.header["send_ns"] = message.records["pose_ns"] = now_ns
                message.records["position"] = tips
                poses.publish(message)
                print(f"{np.isfinite(tips[:, 0]).sum()} fingers are tracked", end="\r", flush=True)
            before = tips
            time.sleep(0.004)


if __name__ == "__main__":
    main(sys.argv[1])
