"""The reading process: reads frames until its standard input ends, and prints when it saw each.

``reader.py ADDRESS spin|wait`` prints a line when it is ready, then number and age (ns since ``publish_ns``)
of each newly seen frame.
"""

import sys
import threading
import time

import proximity


def main() -> None:
    """Read until standard input ends."""
    address, manner = sys.argv[1:]
    over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
    seen = []
    with proximity.open_subscriber(address) as frames:
        print("ready", flush=True)
        while not over.is_set():
            reading = frames.read() if manner == "spin" else frames.wait(0.05)
            if reading.is_new:
                now = time.monotonic_ns()
                seen.append((int(reading.header["sequence"]), now - int(reading.header["publish_ns"])))
    print(*(f"{number} {age}" for number, age in seen))


if __name__ == "__main__":
    main()
