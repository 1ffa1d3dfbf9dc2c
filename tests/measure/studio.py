"""Time from a move of a slider to its picture on the page of `sepmc studio`, in headless Chromium.

``python tests/measure/studio.py [NAME ...]``. Target: median <= 0.3 s for 2,000 cases of table2.
"""

import statistics
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Thread

import sepmc
from sepmc.cli.figures import ranked_outcomes
from sepmc.scene.messages import no_log
from sepmc.studio.answers import Studio
from sepmc.studio.server import Server
from sepmc.studio.sliders import first_sliders

sys.path.insert(0, str(Path(__file__).parents[1]))
from support.browser import Page

CASES, MOVES = 2000, 40
MOVE = """new Promise(done => {
  const before = sepmcTimes.length, ranges = document.querySelectorAll('.slider input[type=range]');
  const range = ranges[NUMBER % ranges.length];
  const [low, high] = [Number(range.min), Number(range.max)];
  range.value = low + SHARE * (high - low);
  range.dispatchEvent(new Event('input'));
  const look = () => sepmcTimes.length > before ? done(sepmcTimes.at(-1)) : setTimeout(look, 5);
  look();
})"""


def main(names: list[str]) -> None:
    """Serve, open, move."""
    for name in names or ["table2"]:
        campaign = sepmc.load(name, {"run.history_step_s": 0.0})
        sliders = first_sliders(campaign, {})
        with ThreadPoolExecutor(1) as second:
            studio = Studio(campaign, sliders, ranked_outcomes, dict, second, CASES, 1)
            studio.prepare(no_log)
            with Server(studio) as server:
                Thread(target=server.serve_forever, daemon=True).start()
                with Page(server.address, size=(1280, 800)) as page:
                    page.evaluate(MOVE.replace("NUMBER", "0").replace("SHARE", "0.5"))
                    times = [
                        page.evaluate(
                            MOVE.replace("NUMBER", str(7 * k)).replace("SHARE", f"{0.4 + k / 400}")
                        )
                        for k in range(MOVES)
                    ]
                    assert page.errors == []
                server.shutdown()
        times.sort()
        print(
            f"{name}, {CASES} cases, {MOVES} moves of {len(sliders)} parameters: median "
            f"{statistics.median(times):.0f} ms, 90 % {times[int(0.9 * MOVES)]:.0f} ms, slowest "
            f"{times[-1]:.0f} ms",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
