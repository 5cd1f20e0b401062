"""Opening a page in the browser of this machine, without its token in the arguments of a program."""

import atexit
import html
import shutil
import tempfile
import webbrowser
from pathlib import Path

_REDIRECT = '<!DOCTYPE html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={url}">\n'


def open_in_browser(url: str) -> None:
    """Have the browser read the address from a file that only this user can read, until this process ends.

    Every user of the machine may see the arguments of the browser.
    """
    folder = tempfile.mkdtemp(prefix="proximity-open-")  # mode 0700
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    redirect = Path(folder, "open.html")
    redirect.touch(0o600)
    redirect.write_text(_REDIRECT.format(url=html.escape(url)), encoding="utf-8")
    webbrowser.open(redirect.as_uri())
