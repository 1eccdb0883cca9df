"""The most memory of another process that is no file's: `python watch.py PID`.

From outside, for threads of its own see nothing while a library works without letting them.
Looks every `WATCHED` seconds until standard input ends, then prints bytes; 0 where the system does
not tell.
"""

import sys
import time
from pathlib import Path
from threading import Thread

WATCHED = 0.02


def status(name: str, process: str = "self") -> int:
    """Bytes, of a line of /proc/PROCESS/status; 0 where there is none."""
    try:
        for line in Path(f"/proc/{process}/status").read_text().splitlines():
            if line.startswith(f"{name}:"):
                return int(line.split()[1]) << 10
    except OSError:
        pass
    return 0


def main() -> None:
    process, most = sys.argv[1], 0
    over = Thread(target=sys.stdin.read, daemon=True)
    over.start()
    print(flush=True)
    while over.is_alive():
        most = max(most, status("RssAnon", process))
        time.sleep(WATCHED)
    print(most)


if __name__ == "__main__":
    main()
