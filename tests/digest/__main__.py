"""Write or compare the digest: `python -m tests.digest --make` or `--compare [NAME ...]`."""

from __future__ import annotations

import argparse
import time

from tests.digest.digest import computed, differences, read, write
from tests.digest.items import chosen


def main() -> int:
    """Make or compare; return 1 if a table differs, is missing or is new, or an item fails."""
    parser = argparse.ArgumentParser(prog="python -m tests.digest", description=__doc__)
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--make", nargs="*", metavar="NAME", help="write digest.json")
    action.add_argument("--compare", nargs="*", metavar="NAME", help="compute again and compare")
    action.add_argument("--list", action="store_true", help="print the names of the items")
    parser.add_argument("--quick", action="store_true", help="only the items of `make test`")
    words = parser.parse_args()
    items = chosen(words.make or words.compare or (), words.quick)
    if words.list:
        print(*(item.name for item in items), sep="\n")
        return 0
    begin = time.perf_counter()
    hashes, skipped, failed = computed(items, lambda line: print(line, flush=True))
    print(f"{len(items)} items, {len(hashes)} tables, {time.perf_counter() - begin:.0f} s")
    if words.make is None:
        lines = list(differences(items, hashes, skipped, failed))
        print(*lines or ["no difference"], sep="\n")
        return bool(lines)
    names = [item.name for item in items if item.name not in (*skipped, *failed)]
    others = {
        key: value
        for key, value in read().items()
        if not any(key.startswith(f"{name}/") for name in names)
    }
    write(others | hashes)
    return bool(failed)


if __name__ == "__main__":
    raise SystemExit(main())
