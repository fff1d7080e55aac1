"""Write or compare the digest: `python -m tests.digest --make`, `--add` or `--compare [NAME ...]`.

Networks, and what follows from their actions, hang on the order in which a processor adds. `--add`
says at the same commit what another processor gives; a table then may have either hash.
"""

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
    action.add_argument("--add", nargs="*", metavar="NAME", help="add hashes of this processor")
    action.add_argument("--compare", nargs="*", metavar="NAME", help="compute again and compare")
    action.add_argument("--list", action="store_true", help="print the names of the items")
    parser.add_argument("--quick", action="store_true", help="only the items of `make test`")
    words = parser.parse_args()
    items = chosen(words.make or words.add or words.compare or (), words.quick)
    if words.list:
        print(*(item.name for item in items), sep="\n")
        return 0
    begin = time.perf_counter()
    hashes, skipped, failed = computed(items, lambda line: print(line, flush=True))
    print(f"{len(items)} items, {len(hashes)} tables, {time.perf_counter() - begin:.0f} s")
    stored = read()
    if words.compare is not None:
        lines = list(differences(items, hashes, skipped, failed))
        print(*lines or ["no difference"], sep="\n")
        return bool(lines)
    if words.add is not None:
        stored |= {key: sorted({*stored.get(key, []), value}) for key, value in hashes.items()}
    else:
        names = [item.name for item in items if item.name not in (*skipped, *failed)]
        stored = {
            key: values
            for key, values in stored.items()
            if not any(key.startswith(f"{name}/") for name in names)
        } | {key: [value] for key, value in hashes.items()}
    write(stored)
    return bool(failed)


if __name__ == "__main__":
    raise SystemExit(main())
