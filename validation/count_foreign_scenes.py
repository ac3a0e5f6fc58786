#!/usr/bin/env python3
"""Count how many scenes of pbrt in folders of other people pass `scene check`.

    count_foreign_scenes.py FLUORSPAR FOLDER...

Every .pbrt file with a WorldBegin is checked by the program FLUORSPAR, equal files once. Scenes whose own files are not all there are
counted apart. What is refused is printed with its message.
"""

import hashlib
import subprocess
import sys
from collections import Counter
from pathlib import Path


def scenes(folders):
    known = set()
    for path in sorted(path for folder in folders for path in Path(folder).rglob("*.pbrt")):
        data = path.read_bytes()
        digest = hashlib.sha256(data).digest()
        if b"WorldBegin" in data and digest not in known:
            known.add(digest)
            yield path


def check(program, path):
    command = [program, "scene", "check", str(path), "--no-cache"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    if done.returncode == 0:
        return "read"
    if "No such file" in done.stderr or "Git LFS" in done.stderr:
        return "incomplete"
    print(done.stderr.strip())
    return "refused" if done.returncode == 2 else "failed"


def main():
    program, *folders = sys.argv[1:]
    counts = Counter(check(program, path) for path in scenes(folders))
    print(", ".join(f"{number} {kind}" for kind, number in sorted(counts.items())))


if __name__ == "__main__":
    main()
