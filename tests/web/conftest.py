"""One browser per test file."""

import browsing
import pytest


@pytest.fixture(scope="module")
def chromium():
    with browsing.browser() as running:
        yield running
