"""A mapping process that takes no time: the recording's text says how it ends. Its options are those of the real one."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path

OF_RECORDING = 3  # `bag_runs.OF_RECORDING`, whose import would take longer than everything else here


def _end_with_starter() -> None:
    os.read(0, 1)
    os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    """Map; a checkpoint in the output folder counts the tries."""
    threading.Thread(target=_end_with_starter, daemon=True).start()
    recording, out = Path(sys.argv[2]), Path(sys.argv[4])
    text = recording.read_text().strip()
    checkpoint = out / "checkpoint.npz"
    tries = int(checkpoint.read_text()) + 1 if checkpoint.exists() else 1
    checkpoint.write_text(str(tries))
    if text == "broken":
        print("waychair: this recording is broken; record it again", file=sys.stderr)
        sys.exit(OF_RECORDING)
    if text == f"killed {tries}" or text == "always killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if text.startswith("waits for "):
        (out / "map.pgm").write_bytes(b"half")
        (recording.parent / "began").write_text(str(os.getpid()))
        while not Path(text.removeprefix("waits for ")).exists():
            time.sleep(0.02)
    (out / "map.pgm").write_bytes(b"P5 2 1 255\n" + text.encode()[:2].ljust(2))
    (out / "report.json").write_text(f'{{"tries": {tries}}}')
    checkpoint.unlink()


if __name__ == "__main__":
    main()
