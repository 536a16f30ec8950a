"""Files as they appear in a folder, each when it is finished."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from . import Options, Step, Unfit, files

# A file that has not changed for so long is taken to be finished, and one that cannot be read is looked at again for so long.
SETTLED_SECS, UNREADABLE_SECS, POLL_SECS = 0.3, 10.0, 0.1


def numbered(path: Path) -> tuple[list[int], str]:
    """Order of files: by the numbers in their names."""
    # Of "x_0007_64x64x64_float32.raw" the shape and the type are none.
    name = re.sub(r"\d+x\d+x\d+|(u?int|float)\d+", "", path.name.split(".")[0])
    return [int(digits) for digits in re.findall(r"\d+", name)], path.name


def number_of(path: Path) -> int | None:
    """The last number in the name."""
    numbers = numbered(path)[0]
    return numbers[-1] if numbers else None


def pass_over(what: object, error: Exception) -> None:
    """Says that a step is not shown, and why."""
    print(f"{what}: passed over: {str(error).removeprefix(f'{what}: ')}", file=sys.stderr, flush=True)


def state(path: Path) -> tuple[int, int]:
    """What changes while a file, or a store that is a folder, is written."""
    entries = [path, *path.rglob("*")] if path.is_dir() else [path]
    facts = [entry.stat() for entry in entries]
    return sum(of.st_size for of in facts), max(of.st_mtime_ns for of in facts)


def candidates(source: Path) -> list[Path]:
    """Files of known endings in a folder, or those that match a pattern."""
    found = source.glob("*") if source.is_dir() and not files.is_known(source) else source.parent.glob(source.name)
    return sorted((path for path in found if files.is_known(path) and not path.name.startswith(".")), key=numbered)


def steps(source: Path, options: Options) -> Iterator[Step]:
    """A step a file. One that stays unreadable is passed over, and said so."""
    done: set[Path] = set()
    seen: dict[Path, tuple[tuple[int, int], float]] = {}
    last_number, newest = -1, time.monotonic()
    while not options.stopped():
        for path in candidates(source):
            if path in done:
                continue
            now = time.monotonic()
            try:
                is_now = state(path)
            except FileNotFoundError:
                continue
            if seen.get(path, (None, 0.0))[0] != is_now:
                # What was there before has been as it is for that long.
                age = time.time() - is_now[1] / 1e9
                seen[path] = is_now, now - max(age, 0.0)
            quiet = now - seen[path][1]
            if quiet < SETTLED_SECS:
                # Later files wait, so that steps come in order.
                break
            try:
                step = files.read_file(path, options)
            except ImportError:
                raise
            except Exception as error:
                may_change = isinstance(error, (OSError, ValueError, files.NotReady, KeyError)) and not isinstance(error, Unfit)
                if may_change and quiet < UNREADABLE_SECS:
                    break
                pass_over(path, error)
                done.add(path)
                newest = time.monotonic()
                continue
            done.add(path)
            number = number_of(path)
            step.number = number if number is not None and number > last_number else last_number + 1
            last_number, newest = step.number, time.monotonic()
            yield step
        if time.monotonic() - newest > options.quiet_secs:
            return
        time.sleep(POLL_SECS)
