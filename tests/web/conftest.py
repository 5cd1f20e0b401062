"""One browser for each file of tests."""

import browsing
import pytest


@pytest.fixture(scope="module")
def chromium():
    with browsing.browser() as running:
        yield running
