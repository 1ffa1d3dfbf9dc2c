"""Report with ten replays: size, time to open in Chromium, requests to other addresses, violations
of accessibility rules.

``AXE=axe.min.js python tests/measure/report.py [NAME ...]``; without ``AXE`` (from ``npm pack
axe-core``) accessibility is not checked. Targets: 8 MB, 2 s, none, none.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

from click.testing import CliRunner

import sepmc
from sepmc.cli import app

sys.path.insert(0, str(Path(__file__).parents[1]))
from support.browser import Page

CASES, REPLAYS = 200, range(10, 20)


def main(names: list[str]) -> None:
    """Run, report, open."""
    for name in names or ["table2", "fairing", "lightband"]:
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / "run"
            sepmc.load(name).run(CASES, out=run)
            chosen = ",".join(map(str, REPLAYS))
            begin = time.process_time()
            called = CliRunner().invoke(
                app.main, ["report", str(run), "--no-replay", "--replays", chosen]
            )
            assert called.exit_code == 0, called.output
            seconds = time.process_time() - begin
            path = run / "report.html"
            megabytes = path.stat().st_size / 1e6
            opened, elsewhere, violations = [], set(), "not checked"
            for _ in range(3):
                with Page(path) as page:
                    opened.append(page.opened_s)
                    elsewhere |= {
                        one for one in page.requests if not one.startswith(("file:", "data:"))
                    }
                    assert page.errors == []
                    if "AXE" in os.environ:
                        page.evaluate(Path(os.environ["AXE"]).read_text(encoding="utf-8"))
                        rules = page.evaluate("axe.run().then(r => r.violations.map(v => v.id))")
                        violations = ", ".join(rules) or "none"
            print(
                f"{name}: {len(REPLAYS)} replays, {megabytes:.2f} MB, opens in {min(opened):.2f} "
                f"to {max(opened):.2f} s, {len(elsewhere)} other addresses, accessibility "
                f"violations: {violations}; written in {seconds:.0f} s of CPU of its first process",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:])
