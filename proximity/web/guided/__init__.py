"""Guided pages: a program leads a person through steps in a browser, and a second page watches.

    with GuidedPages("Calibration") as pages:
        open_in_browser(pages.url)
        answer = pages.ask(Step("Pose 1", "Lay the hand flat.", buttons=(Button("take", "Take", "Enter"),)))

The program asks; pages only show and answer. They have the checks of `proximity.web.server`.
"""

from proximity.web.guided.guided_pages import GuidedPages, PageLeftError, StoppedError
from proximity.web.guided.steps import Answer, Button, Field, Step

__all__ = ["Answer", "Button", "Field", "GuidedPages", "PageLeftError", "Step", "StoppedError"]
