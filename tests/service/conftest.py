"""Fixtures common to tests of inputs by messages."""

import pytest
from fake_service import QueueInlet

from proximity.service.inputs import inbox


@pytest.fixture
def inlet(monkeypatch):
    """A queue that replaces the inlet of an input's address."""
    queue = QueueInlet()
    monkeypatch.setattr(inbox, "open_inlet", lambda address: queue)
    return queue
