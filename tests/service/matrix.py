"""The fault matrix: what is done to a real service, whether it holds, and how many do and do not.

python -m tests.service.matrix [arguments of pytest]
"""

import sys
from pathlib import Path

import pytest


class Rows:
    """Prints a row for each test, and counts."""

    def __init__(self):
        self.counts = {"passed": 0, "failed": 0}

    def pytest_runtest_logreport(self, report):
        if report.when == "call" or report.failed:
            outcome = "failed" if report.failed else report.outcome
            self.counts[outcome] = self.counts.get(outcome, 0) + 1
            name = report.nodeid.rpartition("::")[2].removeprefix("test_").replace("_", " ", 30)
            print(f"{outcome:8}{name}", flush=True)
            if report.failed:
                print(report.longreprtext, file=sys.stderr)


def main(arguments):
    rows = Rows()
    folder = str(Path(__file__).parent)
    own = ["-p", "no:terminal", "-o", "addopts=--import-mode=importlib"]
    status = pytest.main([folder, *own, *arguments], plugins=[rows])
    print(", ".join(f"{count} {outcome}" for outcome, count in rows.counts.items()))
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
