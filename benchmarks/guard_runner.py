"""One side of the guard: a process that reconstructs captures on request and answers with the seconds of each stage.

Run by file, not as a module, so that it can time a checkout of the project that has no such file:
``python guard_runner.py SLOWED CAPTURE.npz …`` with the checkout's parent first on PYTHONPATH. A line on stdin asks
for one round; the answer is one line of JSON. SLOWED is the share of the job's time to waste on purpose.
"""

import json
import sys
import time

time.perf_counter = time.process_time
"""The pipeline's own clock counts seconds of CPU: other programs disturb them least."""

SLOWED_CALL = 3
"""The time is wasted in one piece, as the third stage begins: the stage before it ends then."""


def main() -> None:
    import mirror_scan
    from mirror_scan.core.capture import open_capture
    from mirror_scan.core.pipeline import reconstruct

    slowed = float(sys.argv[1])
    captures = [open_capture(path) for path in sys.argv[2:]]
    before = [0.0] * len(captures)

    def answer(value: object) -> None:
        sys.stdout.write(json.dumps(value) + "\n")
        sys.stdout.flush()

    def one_round() -> dict[str, float]:
        laps: dict[str, float] = {}
        for k, capture in enumerate(captures):
            calls = 0

            def waste(fraction: float, message: str, k: int = k) -> None:
                nonlocal calls
                calls += 1
                if calls == SLOWED_CALL:
                    end = time.process_time() + slowed * before[k]
                    while time.process_time() < end:
                        pass

            start = time.process_time()
            report = reconstruct(capture, progress=waste).report
            if not before[k]:
                before[k] = -1.0  # the first round loads the compiled code: it tells nothing of the job's time
            elif before[k] < 0:
                before[k] = time.process_time() - start
            for stage, ms in report["timings_ms"].items():
                laps[stage] = laps.get(stage, 0.0) + ms / 1e3
        return laps

    for _ in range(2):
        one_round()
    answer(list(mirror_scan.__path__))
    for _ in sys.stdin:
        answer(one_round())


main()
