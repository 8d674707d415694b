"""The explorer in a real browser, and its server, for tests."""

import shutil
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

WAIT = 60  # seconds, on a machine that has much else to do
READY = "return document.documentElement.dataset.ready"


@contextmanager
def chromium():
    """A page in headless Chromium, of Debian's packages for instance; the test is skipped where there is none."""
    webdriver = pytest.importorskip("selenium.webdriver")
    program, driver = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
    if program is None or driver is None:
        pytest.skip("there is no chromium with chromedriver")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for argument in (
        "--headless=new",
        "--no-sandbox",
        "--disable-dev-shm-usage",
        "--enable-unsafe-swiftshader",
        "--window-size=1440,1000",
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    started = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    started.set_script_timeout(WAIT)
    try:
        yield Page(started)
    finally:
        started.quit()


class Page:
    """A page in a browser."""

    def __init__(self, driver):
        self.driver = driver

    def open(self, address):
        """A file, or what is at an address."""
        self.driver.get_log("browser")
        self.driver.get(address if isinstance(address, str) else address.absolute().as_uri())
        self.until(READY)

    def js(self, code, *arguments):
        return self.driver.execute_script(code, *arguments)

    def until(self, code):
        """What is returned, once it is true."""
        end = time.monotonic() + WAIT
        while not (value := self.js(code)):
            assert time.monotonic() < end, code
            time.sleep(0.05)
        return value

    def rest(self):
        """So that what follows is not one with what was before."""
        time.sleep(1)

    def text(self, name):
        return self.js("return document.getElementById(arguments[0]).textContent", name)

    def place(self, plot, x, y):
        """Where data are in the window, (x, y) of a map."""
        self.js("document.querySelectorAll('.map .plot')[arguments[0]].scrollIntoView({block: 'center'})", plot)
        return self.js(
            """const [k, x, y] = arguments, figure = Bokeh.documents[0].roots()[k];
            const box = document.querySelectorAll('.map .plot')[k].getBoundingClientRect();
            const { frame } = Bokeh.index.find_one(figure);
            return [box.left + frame.x_scale.compute(x), box.top + frame.y_scale.compute(y)];""",
            plot, x, y,
        )  # fmt: skip

    def mouse(self, kind, place, **options):
        event = {"type": kind, "x": place[0], "y": place[1], **options}
        self.driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)

    def click(self, place):
        self.mouse("mouseMoved", place)
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, place, button="left", clickCount=1)

    def lasso(self, corners):
        self.mouse("mouseMoved", corners[0])
        self.mouse("mousePressed", corners[0], button="left", clickCount=1)
        for one, other in zip(corners, [*corners[1:], corners[0]], strict=True):
            for share in np.linspace(0.1, 1, 10):
                place = [a + share * (b - a) for a, b in zip(one, other, strict=True)]
                self.mouse("mouseMoved", place, button="left", buttons=1)
        self.mouse("mouseReleased", corners[0], button="left", clickCount=1)

    def saved(self, button):
        """What a button saves."""
        self.js("window.blob = null; URL.createObjectURL = (blob) => { window.blob = blob; return '#'; };")
        self.js("document.getElementById(arguments[0]).click()", button)
        return self.driver.execute_async_script("window.blob.text().then(arguments[0])")

    def troubles(self):
        """What went wrong, and what was asked of the network."""
        entries = self.driver.get_log("browser")
        said = [entry["message"] for entry in entries if entry["level"] != "INFO" and entry["source"] != "rendering"]
        return said + self.js(
            "return performance.getEntriesByType('resource').map((e) => e.name).filter((n) => !/^(data|blob):/.test(n))"
        )


class serving:
    """A server in a thread of its own."""

    def __init__(self, folder, task=None):
        from auroraqd.report.explorer.serving import Server  # which takes seconds to import, and conftest.py imports this

        self.server = Server(folder, most=1000, task=task)

    def __enter__(self):
        self.thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.05})
        self.thread.start()
        return self.server

    def __exit__(self, *_):
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()
