"""How quick the page is: from a plan's arrival to its first frame, and frames a second while it plays.

    python -m benchmarks.page [--url http://127.0.0.1:8000] [--runs 5] [--seconds 4]

It needs a running service, playwright and a Chromium. The plan is the page's own example, driven slowly and
sampled every 5 ms: some 6,000 samples. Times are measured in the page: from the moment the whole answer is
there to the end of the frame that first shows it, charts included.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
from typing import Any

from playwright.sync_api import sync_playwright

ARGUMENTS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip

SLOW = """async () => (await import("/static/state.js")).edit((request) => {
  Object.assign(request.robot.limits, { wheel_speed: 4, wheel_acceleration: 5 });
  Object.assign(request.options, { sample_period: 0.005, effort: "first" });
}, "all")"""

FIRST_FRAME = """() => {
  const last = (name) => performance.getEntriesByName(name).at(-1)?.startTime ?? 0;
  const took = last("plan-first-frame") - last("plan-response");
  return took > 0 ? took : null;
}"""

FRAMES = """(seconds) => new Promise((resolve) => {
  const times = [];
  const count = (now) => {
    times.push(now);
    if (now - times[0] < 1000 * seconds) requestAnimationFrame(count);
    else resolve(times.slice(1).map((time, i) => time - times[i]));
  };
  requestAnimationFrame(count);
})"""


def measure(url: str, runs: int, seconds: float) -> None:
    """Prints the figures."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        cold: list[float] = []
        warm: list[float] = []
        gaps: list[float] = []
        samples: Any = None
        for _ in range(runs):
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.goto(url)
            page.wait_for_selector("html[data-ready]")
            page.evaluate(SLOW)
            for waits in (cold, warm):
                page.evaluate("performance.clearMarks()")
                page.click("#plan")
                waits.append(page.wait_for_function(FIRST_FRAME).json_value())
            gaps += page.evaluate(FRAMES, seconds)
            samples = page.evaluate("import('/static/state.js').then((m) => m.state.motion.samples)")
            page.close()
        browser.close()
    late = sorted(gaps)[int(0.99 * len(gaps))]
    print(f"{samples} samples, 1280 × 800, headless, no GPU, {runs} runs")
    for name, waits in (("first plan of a page", cold), ("second", warm)):
        middle, worst = statistics.median(waits), max(waits)
        print(f"answer to first frame, {name}: median {middle:.0f} ms, worst {worst:.0f} ms")
    print(f"playing: {1e3 / statistics.mean(gaps):.0f} frames/s, 99 % of frames within {late:.0f} ms")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:8000")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=4.0)
    given = parser.parse_args()
    measure(given.url, given.runs, given.seconds)
