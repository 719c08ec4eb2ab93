#!/usr/bin/env python3
"""Makes the corpus of a reader from its seeds and the smallest inputs of a minimised set.

    tools/fuzz/keep.py MINIMISED CORPUS BYTES

Files of CORPUS whose names are no hash are seeds, which stay; the others are replaced by files of MINIMISED, the smallest
first, as long as all have at most BYTES bytes.
"""

import pathlib
import re
import shutil
import sys

minimised, corpus, limit = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]), int(sys.argv[3])
corpus.mkdir(parents=True, exist_ok=True)
for path in corpus.iterdir():
    if re.fullmatch("[0-9a-f]{40}", path.name):
        path.unlink()
seeds = {path.read_bytes() for path in corpus.iterdir()}
total = sum(map(len, seeds))
for path in sorted(minimised.iterdir(), key=lambda path: (path.stat().st_size, path.name)):
    if path.read_bytes() not in seeds and (total := total + path.stat().st_size) <= limit:
        shutil.copy(path, corpus / path.name)
print(f"{corpus.name}: {len(list(corpus.iterdir()))} inputs, {sum(path.stat().st_size for path in corpus.iterdir())} bytes")
