"""Opening a name of iceoryx2, and taking it back from processes that were killed.

iceoryx2 itself notices the dead whenever somebody joins it, opens a name or leaves. What it does not get over
are those that were killed while they made something, in a fraction of a millisecond: whoever looks after the
dead waits for the half-made memory for ever (`remove_unfinished_memory`), and a half-made name is refused for
ever (`_remove_unfinished_name`). Seen with 0.10.0 once in some ten thousand, and once in fifty, of processes
killed while they opened a name.
"""

import ctypes
import hashlib
import stat
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import iceoryx2

from proximity.errors import PublishError
from proximity.transport.address import Address

NAME_PREFIX = "proximity/"
"""Prefix of all service names, which keeps them apart from those of other programs on the machine."""
BUFFER = 64
"""Messages that wait for a subscriber; then the oldest is lost."""
SUBSCRIBERS = 16
"""Of a name, at most."""
NODES = 2 * SUBSCRIBERS
"""Ends that have a name open, those that were killed and not yet noticed included."""
LOCK_TIMEOUT = 0.3
"""s to try again where a publisher or subscriber may just be leaving."""
UNFINISHED_AFTER = 1.0
"""s: nobody alive takes as long to make a name or a piece of memory; iceoryx2 waits no longer for a name."""
MEMORY = Path("/dev/shm")
"""Where Linux shows shared memory as files; elsewhere nothing is done about what is half-made."""


def open_service(address: Address, role: str) -> tuple[Any, Any]:
    """Join iceoryx2 as a node, open the address's service, or make it where there is none.

    Returns the node, to be kept as long as the service is used, and the service.
    """
    service_name = NAME_PREFIX + address.location
    try:
        name = iceoryx2.ServiceName.new(service_name)
    except iceoryx2.SemanticStringError as unfit:
        longest = iceoryx2.ServiceName.max_len() - len(NAME_PREFIX)
        raise address.refuse(f"expected a name of at most {longest} ASCII characters ({unfit})") from None
    remove_unfinished_memory()
    node = _join(address, role)
    try:
        return node, _open(node, name)
    except iceoryx2.PublishSubscribeOpenOrCreateError as failure:
        if "HangsInCreation" not in str(failure):
            raise _explained(address, failure) from None
    _remove_unfinished_name(node, service_name)
    try:
        return node, _open(node, name)
    except iceoryx2.PublishSubscribeOpenOrCreateError as failure:
        raise _explained(address, failure) from None


def create_end(create: Callable[[], Any], address: Address, node: Any, service: Any, role: str) -> Any:
    """Make a publisher or a subscriber by *create*; try again while the service seems to be full."""
    ends = time.monotonic() + LOCK_TIMEOUT
    while True:
        try:
            return create()
        except (iceoryx2.PublisherCreateError, iceoryx2.SubscriberCreateError) as failure:
            if "ExceedsMaxSupported" not in str(failure):
                raise address.refuse(f"iceoryx2 refuses a {role} ({failure})") from None
            if time.monotonic() >= ends:
                raise address.refuse(_in_use_message(role, node, service)) from None
        service.blocking_cleanup_dead_nodes(iceoryx2.Duration.from_millis(100))
        time.sleep(0.01)


def remove_unfinished_memory() -> None:
    """Remove memory that nobody finished making; where some may still be finished, wait for it.

    To be called before anything that looks after the dead. A publisher that hangs because its subscriber
    was killed while it came goes on when somebody else, that subscriber started anew for example, calls it.
    """
    prefix = iceoryx2.config.global_config().global_cfg.prefix.to_string()
    ends = time.monotonic() + 2.0 * UNFINISHED_AFTER
    while not all(_is_finished(file) for file in MEMORY.glob(f"{prefix}*")) and time.monotonic() < ends:
        time.sleep(0.01)


def _is_finished(file: Path) -> bool:
    """Whether a piece of memory is there to stay, or was removed."""
    try:
        status = file.stat()
        if status.st_mode & stat.S_IRUSR:  # may not be read before it is finished
            return True
        if time.time() - status.st_mtime < UNFINISHED_AFTER:
            return False
        file.unlink()
    except OSError:
        pass  # somebody else was faster, or may do it
    return True


def _join(address: Address, role: str) -> Any:
    """Make a node: what tells the others that this process lives."""
    builder = iceoryx2.NodeBuilder.new().name(iceoryx2.NodeName.new(NAME_PREFIX + role))
    builder = builder.signal_handling_mode(iceoryx2.SignalHandlingMode.Disabled)
    try:
        return builder.create(iceoryx2.ServiceType.Ipc)
    except iceoryx2.NodeCreationFailure as failure:
        folder = iceoryx2.config.global_config().global_cfg.root_path.to_string()
        raise address.refuse(
            f"iceoryx2 cannot be used ({failure}); {folder} belongs to the user who used it first"
        ) from None


def _open(node: Any, name: Any) -> Any:
    """Open the service of that name, or make it."""
    builder = node.service_builder(name).publish_subscribe(iceoryx2.Slice[ctypes.c_uint8])
    builder = builder.max_publishers(1).max_subscribers(SUBSCRIBERS).max_nodes(NODES)
    builder = builder.history_size(1).enable_safe_overflow(True)
    builder = builder.subscriber_max_buffer_size(BUFFER).subscriber_max_borrowed_samples(1)
    return builder.open_or_create()


def _explained(address: Address, failure: Exception) -> PublishError:
    """Say why a service could not be opened."""
    reason = str(failure)
    if "ExceedsMaxNumberOfNodes" in reason:
        return address.refuse(f"{NODES} publishers and subscribers have it open, the maximum")
    if "Incompatible" in reason or "DoesNotSupport" in reason:
        return address.refuse(
            f"another program made it with other settings ({reason}); expected slices of uint8, 1 publisher, "
            f"{SUBSCRIBERS} subscribers, {NODES} nodes, a history of 1, and buffers of {BUFFER} that overflow"
        )
    return address.refuse(f"cannot be opened ({reason})")


def _in_use_message(role: str, node: Any, service: Any) -> str:
    """Say which process publishes already, or that there are no more subscribers to be had."""
    if role == "subscriber":
        return f"has {SUBSCRIBERS} subscribers already, the maximum"
    for state in service.nodes:
        other = state[0]
        is_another = isinstance(state, iceoryx2.NodeState.Alive) and other.id != node.id
        if is_another and other.details and other.details.name.as_str() == NAME_PREFIX + role:
            program = other.details.executable.to_string()
            return f"is in use: process {other.details.process_id} ({program}) publishes there"
    return "is in use: another process publishes there"


def _remove_unfinished_name(node: Any, service_name: str) -> None:
    """Remove the file of a service that nobody finished making.

    iceoryx2 0.10 names it by a hash of the name, and makes it unwritable when it is finished. Killed before,
    the maker leaves a name that nobody can open or remove through iceoryx2, not by force either.
    """
    settings = node.config.global_cfg
    of_publish_subscribe = b"0" + service_name.encode()
    digest = hashlib.sha1(of_publish_subscribe, usedforsecurity=False).hexdigest()
    suffix = settings.service.static_config_storage_suffix.to_string()
    file = Path(settings.service_dir.to_string()) / f"{settings.prefix.to_string()}{digest}{suffix}"
    try:
        status = file.stat()
        age = time.time() - status.st_mtime
        if status.st_mode & stat.S_IWUSR and age >= UNFINISHED_AFTER:
            file.unlink()
    except OSError:
        pass  # somebody else was faster, or may do it
