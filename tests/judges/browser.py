"""Chromium, and what every page has to satisfy in it: axe finds nothing inaccessible, and nothing is wider than the window."""

from collections.abc import Iterator
from contextlib import contextmanager

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, sync_playwright

# Width of a phone's window.
PHONE = 400
# Widths of other windows, with the colours that the system asks for.
SCREENS = [(width, scheme) for width in (1280, 2560) for scheme in ("light", "dark")]


@contextmanager
def chromium() -> Iterator[Browser]:
    """The browser, closed at the end."""
    with sync_playwright() as playwright:
        # A container's root has no sandbox.
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        yield browser
        browser.close()


def check_access(page: Page, what: str) -> None:
    violations = Axe().run(page).response["violations"]
    found = [f"{one['id']}: {one['help']}: {one['nodes'][0]['html']}" for one in violations]
    assert not found, f"{what}: {found}"


def check_width(page: Page, what: str) -> None:
    """Nothing is wider than the window."""
    found = page.evaluate("document.documentElement.scrollWidth")
    window = page.viewport_size["width"]
    assert found <= window, f"{what}: {found} px wide in a window of {window} px"
