"""What tests of inputs by messages share."""

import pytest
from fake_service import QueueInlet

from proximity.service.inputs import inbox


@pytest.fixture
def inlet(monkeypatch):
    """A queue where an input's address would be."""
    queue = QueueInlet()
    monkeypatch.setattr(inbox, "open_inlet", lambda address: queue)
    return queue
