"""All C of the package but the controller's: the library, a service's loop, mailbox, receiver, extension.

Each has a folder. Layouts of records and numbers that they share with Python are generated from Python's.
"""

from pathlib import Path

CORE = Path(__file__).parent
"""The folder of all sources in C, but for the controller's."""
