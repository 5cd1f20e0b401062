"""All C code of the package except the controller: library, service loop, mailbox, receiver, extension.

Each has a folder. Record layouts and numbers that they share with Python are generated from Python's.
"""

from pathlib import Path

CORE = Path(__file__).parent
"""The folder of all C sources except the controller's."""
