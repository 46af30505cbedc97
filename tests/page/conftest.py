"""Debian's Chromium on the page of a real `wheelplan serve`. Pictures of what it shows go to out/page."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.service.service import ROOT, serving

PICTURES = ROOT / "out" / "page"
ARGUMENTS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip

# Where the browser says how things are: the state that the page's own modules share.
STATE = "import('/static/state.js').then(({ state }) => %s)"


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a service that is ready."""
    with serving(tmp_path_factory.mktemp("data"), workers=1) as server:
        yield f"http://127.0.0.1:{server.port}"


@pytest.fixture(scope="module")  # while Playwright is up, nobody else may run an event loop in this thread
def browser() -> Iterator[Any]:
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("no chromium is installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        yield browser
        browser.close()


Open = Callable[..., "View"]


@pytest.fixture
def open_page(browser: Any, service: str) -> Iterator[Open]:
    """Opens the page as a View. A failing script, or a request to anybody else, fails the test."""
    views: list[View] = []

    def open_(
        width: int = 1280,
        height: int = 800,
        at: str = "/",
        script: str = "",
        of: str | None = None,
        **context: Any,
    ) -> View:
        context.setdefault("color_scheme", "light")
        made = browser.new_context(viewport={"width": width, "height": height}, **context)
        made.set_default_timeout(20_000)
        page = made.new_page()
        view = View(page)
        views.append(view)
        page.on("pageerror", lambda error: view.faults.append(str(error)))
        page.on("console", lambda said: view.hear(said.type, said.text))
        page.on("request", lambda asked: view.asked.append(asked.url))
        if script:
            page.add_init_script(script)
        page.goto((of or service) + at)
        if of is None:
            page.wait_for_selector("html[data-ready]")
        return view

    yield open_
    for view in views:
        view.page.context.close()
        assert view.faults == []
        theirs = ("/".join(view.page.url.split("/")[:3]) + "/", "blob:")
        assert [url for url in view.asked if not url.startswith(theirs)] == []


class View:
    """The page in a browser, with the few things that tests do with it over and over."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.faults: list[str] = []
        self.asked: list[str] = []

    def hear(self, kind: str, text: str) -> None:
        if kind == "error" and "the server responded with a status of" not in text:
            self.faults.append(text)

    def state(self, expression: str) -> Any:
        """What an expression of the page's `state` is now."""
        return self.page.evaluate(STATE % expression)

    def edit(self, change: str) -> None:
        """Changes the request, named r, as the page's own parts do."""
        self.page.evaluate(
            f"import('/static/state.js').then(({{ edit }}) => edit((r) => {{ {change} }}, 'all'))"
        )

    def field(self, pointer: str) -> Any:
        """The input of the field at a JSON pointer."""
        return self.page.locator(f"[data-pointer='{pointer}'] :is(input, select, textarea)").first

    def reveal(self, section: str) -> None:
        """Opens a section of the setup."""
        if self.page.locator(f"details[data-section={section}]").get_attribute("open") is None:
            self.page.click(f"details[data-section={section}] > summary")

    def plan(self) -> None:
        """Presses Plan and waits for what comes of it."""
        self.page.click("#plan")
        self.settle()

    def settle(self) -> None:
        """Waits until nothing is being planned."""
        self.page.wait_for_selector("#plan:not(.busy)")

    def grip(self, name: str) -> tuple[float, float]:
        """Where the middle of a grip is, in pixels."""
        box = self.page.locator(f"[data-grip='{name}']").bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def drag(self, begin: tuple[float, float], end: tuple[float, float]) -> None:
        mouse = self.page.mouse
        mouse.move(*begin)
        mouse.down()
        mouse.move((begin[0] + end[0]) / 2, (begin[1] + end[1]) / 2)
        mouse.move(*end)
        mouse.up()

    def picture(self, name: str) -> None:
        """Saves what is in view."""
        PICTURES.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=PICTURES / f"{name}.png")
