"""The explorer in Chromium: 20,000 skills of 100 numbers (or --skills of them), the size of the file, the first paint, when all
points are drawn, and how soon pointing answers.

    python benchmarks/explorer.py
    python benchmarks/explorer.py --quick    # to see it work: seconds; no conclusions can be drawn

Needs the extra `test`, and Chromium with chromedriver, of Debian's packages `chromium` and `chromium-driver` for instance. What
it says depends on whether the machine has a GPU, and on what else it does. Pointing is measured from the time of the browser's
own pointer event: until the panel has changed, and until the frame after that is drawn. Beside what the clock says there is
what the browser's main thread computed, which says more where the machine has much else to do.
"""

import argparse
import os
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
from selenium import webdriver
from sklearn.decomposition import PCA

import auroraqd

STEPS = 50
OPENED, POINTED = 5, 60  # times
COLUMNS = "descriptor", "load", "written, s", "MB", "first paint, ms", "all drawn, ms"
COLUMNS += "pointing: panel changed, ms (95%)", "drawn, ms (95%)", "computed, ms"
LISTEN = """window.times = []; let since = 0;
document.addEventListener("pointermove", (event) => { since = event.timeStamp; }, true);
document.addEventListener("shown", () => {
  const from = since, panel = performance.now() - from;
  requestAnimationFrame(() => setTimeout(() => window.times.push([panel, performance.now() - from]), 0));
});"""


class Known:
    """The origin of skills that nobody found."""

    def __init__(self, descriptor):
        self._descriptor = descriptor

    def descriptor(self):  # noqa: D102
        return self._descriptor

    def config(self):  # noqa: D102
        return {}

    def history(self):  # noqa: D102
        return auroraqd.history.History()


def repertoire(transformer, n):
    """Skills of random walks, which no compression makes small."""
    rng = np.random.default_rng(0)
    walks = np.cumsum(rng.normal(0, 0.05, (n, STEPS, 2)), axis=1)
    aurora = auroraqd.Aurora(8, transformer, seed=0, prior=walks[:2000])
    columns = {
        "genotype": rng.random((n, 8)),
        "fitness": rng.random(n),
        "observation": walks,
        "descriptor": aurora.describe(walks),
        "ground_truth": walks[:, -1].copy(),
        "curiosity": rng.random(n),
        "reconstruction_error": rng.random(n),
        "id": np.arange(n),
        "born": np.arange(n),
        "parent": (rng.random(n) * np.arange(n)).astype(np.int64) - 1,
    }
    return auroraqd.Repertoire(columns, Known(aurora.descriptor))


def browser():
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader"):
        options.add_argument(argument)
    options.add_argument("--window-size=1440,1000")
    return webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))


def ready(driver, path):
    """Milliseconds until the first paint, and until all points are drawn."""
    driver.get(path.as_uri())
    while not driver.execute_script("return document.documentElement.dataset.ready"):
        time.sleep(0.05)
    time.sleep(1)
    paint = driver.execute_script("return performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? NaN")
    return paint, float(driver.execute_script("return document.documentElement.dataset.ready"))


def computed(driver):
    """Milliseconds that the main thread has computed so far."""
    metrics = driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
    return 1000 * next(metric["value"] for metric in metrics if metric["name"] == "TaskDuration")


def pointing(driver, times):
    """(n, 2) milliseconds from a pointer event until the panel has changed, and until it is drawn."""
    driver.execute_script(LISTEN)
    plot = driver.find_element("css selector", ".map .plot").rect
    for number in range(times):
        place = {"x": plot["x"] + 100 + (number * 37) % 300, "y": plot["y"] + 60 + (number * 53) % 250}
        driver.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": "mouseMoved", **place})
        time.sleep(0.2)
    return np.array(driver.execute_script("return window.times"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--skills", type=int, default=20_000)
    parser.add_argument("--quick", action="store_true", help="200 skills with PCA, opened once, pointed at twice")
    options = parser.parse_args()
    n, opened, pointed = (200, 1, 2) if options.quick else (options.skills, OPENED, POINTED)
    transformers = [PCA(n_components=2), auroraqd.AutoEncoder(n_components=2)][: 1 if options.quick else 2]
    print(f"### The explorer, {n:,} skills of {2 * STEPS} numbers, in Chromium\n")
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    driver = browser()
    try:
        with tempfile.TemporaryDirectory() as folder:
            for transformer in transformers:
                skills, path = repertoire(transformer, n), Path(folder) / "skills.html"
                since = time.perf_counter()
                auroraqd.report.explore(skills, path)
                written = time.perf_counter() - since
                paint, drawn = np.nanmedian([ready(driver, path) for _ in range(opened)], axis=0)
                driver.execute_cdp_cmd("Performance.enable", {"timeDomain": "threadTicks"})
                began = computed(driver)
                (panel, answer), late = np.median(times := pointing(driver, pointed), axis=0), np.quantile(times, 0.95, axis=0)
                cells = [type(transformer).__name__, f"{os.getloadavg()[0]:.1f}", f"{written:.1f}"]
                cells += [
                    f"{path.stat().st_size / 1e6:.1f}",
                    f"{paint:.0f}",
                    f"{drawn:.0f}",
                ]
                cells += [f"{panel:.0f} ({late[0]:.0f})", f"{answer:.0f} ({late[1]:.0f})"]
                print(f"| {' | '.join([*cells, f'{(computed(driver) - began) / pointed:.0f}'])} |", flush=True)
    finally:
        driver.quit()


if __name__ == "__main__":
    main()
