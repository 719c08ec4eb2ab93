#!/usr/bin/env python3
"""Finds words that docs/glossary.md replaces by the field's terms, and terms that lead to no file.

    tools/language.py                  every folder; also the terms that must be greppable
    tools/language.py PATH...          only these files and folders
    tools/language.py --count [PATH...]  hits per folder and rule instead of each hit

Prints `path:line: found → what to write instead` and fails if anything was found.

Text is searched in a normal form: identifiers are split into words (`put_back`, `PutBack` and `PUT_BACK` read
"put back"), comment markers are dropped and lines are joined, so that a phrase is found across a line break.
RULES holds the patterns, GENUINE the uses that are right, TERMS where the field's terms must occur.
Needs the Python standard library and git.
"""

import argparse
import bisect
import collections
import fnmatch
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent

# What is searched. Generated files are left out: their sources are searched.
SEARCHED = ["src", "tests", "benches", "tools", "examples", "presets", "docs", "README.md", "ARCHITECTURE.md", "CHANGELOG.md"]
SUFFIXES = {".rs", ".md", ".py", ".toml", ".sh", ".c", ".html", ""}
SKIPPED = ["tools/language.py", "docs/glossary.md", "docs/parameters.md", "docs/preset.schema.json"]

# Pattern in the normal form (lower case, words), what to write instead, and path patterns if it holds only there.
RULES = [
    (r"(?:tells?|told|telling)", "report, print, log, warn; distinguish"),
    (r"(?:says?|said|saying)", "report, print, log, state"),
    (r"asked|ask(?:s|ing)? (?:for|of)", "requested; the tolerance"),
    (r"ways?", "method, path, search direction, displacement"),
    (r"rounds|(?:a|the|one|two|each|every|per|last|first|next|another|this|that|of|let|mut|for) round(?= of| in| [=:;]|$)|round of", "iterations, sweeps, passes"),
    (r"turns? in sums|turns of the (?:conjugate|solver|loop)|in turns", "iterations, sweeps, passes"),
    (r"lattices?", "seeding lattice, grid, comparison grid"),
    (r"weak(?:er|est)?", "low-circulation; small"),
    (r"strong(?:er|est)? (?:vortons?|nodes?|places?|ones?)|nobody strong|let strong|fn strong", "high-circulation"),
    (r"hand(?:s|ing)? (?:on|over|out|down|its|it|them|their|what|strength|each)|handed|hand on", "redistribute; pass"),
    (r"takers?", "receivers"),
    (r"gifts?", "transfers"),
    (r"bearable|chief", "say the limit; largest"),
    (r"company", "coupled system"),
    (r"fn meets?|let meets?|(?:sheets?|cloths?|points|faces) meets?|meets? each other", "detect contacts; in contact"),
    (r"fn press|fn press all", "project contacts"),
    (r"(?:fn|struct|enum|type|trait) part", "end of substep; say what it is"),
    (r"rub(?:s|bed|bing)?", "apply friction"),
    (r"wet|smoky|clothy", "liquid–cloth coupling; with smoke"),
    (r"blown(?! (?:out|up|away|over|off|by|apart))", "wind coupling"),
    (r"dry(?! run)", "without liquid"),
    (r"beside", "compared with; next to; in addition to"),
    (r"(?:stands?|standing) at|stood", "is, measured"),
    (r"pieces", "connected components; parts"),
    (r"links?", "half-edges", ["src/mesh/*", "tests/numerics/mesh*", "tests/numerics/cleanup*", "tests/numerics/decimation*"]),
    (r"(?:struct|type|enum|fn|let|mod|use|mut) apart|surfaces? (?:are |is |lie |lies )?apart|how far apart", "surface distance (RMS, Hausdorff)"),
    (r"thicken(?:s|ed|ing)?", "offset, shell"),
    (r"caught", "projected out of the solid; rejected"),
    (r"put(?:s|ting)? back", "projected out of the solid"),
    (r"smother(?:s|ed)?", "rejected"),
    (r"unfit", "out of range"),
    (r"rooms?", "capacity, memory budget, space"),
    (r"allowances?", "capacity, memory budget"),
    (r"carried", "advected, interpolated; transferred"),
    (r"carry", "advect, interpolate; transfer", ["src/sim/*", "src/field/*"]),
    (r"mend(?:s|ed|ing)?", "fix"),
    (r"the least|(?:fn|const|let|let mut|static) least|least (?=[=:(])", "minimum"),
    (r"the most(?! (?:\w+ly|recent|common|likely|important|exact|accurate|expensive|general|frequent|part)\b)|(?:fn|const|let|let mut|static) most|most (?=[=:(])", "maximum"),
    (r"(?:let|let mut|mut|self) better", "preconditioned residual"),
    (r"(?:let|let mut|mut|self) rest(?! (?:length|lengths|density|state|shape|angle|angles|volume|area|kernel|new|walls)\b)|r → rest|z → better|p → way",
     "residual, preconditioned residual, search direction", ["src/sim/sheet/implicit*", "src/sim/vortex/*", "src/sim/smoke/*", "src/math/*"]),
    (r"(?:the )?text'?s|way text|the text (?:gives|takes|has|says|uses|does)", "the method of [reference], by name"),
    (r"rectangles?|squares (?:that|of|on|below|under|beside|in)|(?:a|the|each|every|one) square(?= (?:panel|just|below|that|of|on|under))|gives? off air",
     "source panels", ["src/sim/smoke/*", "src/sim/vortex/*", "docs/smoke*", "docs/vortices*"]),
    (r"what goes through|goes? through (?:it|them|walls?|solids?)|slips through", "leakage, through-flow", ["src/sim/smoke/*", "src/run/*", "docs/smoke*", "tests/*smoke*"]),
    (r"lumps?", "under-resolved clusters"),
    (r"nobody(?:'s)?", "name the subject, or use the passive"),
    (r"what (?:is|are) (?:weak|no|told|left out)|what there (?:is|was)|is no (?:number|finite)", "ordinary sentence: subject, verb, object"),
]

# Patterns on raw lines: types and constants whose name says nothing without its context, doc lines that do not stand alone.
RAW_RULES = [
    (r"\b(?:struct|enum|trait|type)\s+(?:Part|Told|Seen|Beside|Line|There|Way|Ways|Woven|Apart|Better|Judge|By|Together|Bound|Blown|Smoky|Row)\b",
     "a type's name says what it is"),
    (r"\bconst\s+(?:MOST|LEAST|ROUNDS|FEW|SAME|MANY|ENOUGH|HANDED|ALIKE|TOGETHER|NEAR|FAR|SLACK|SMALL|TINY|CLOSE|LONG|SHORT)\b(?!: &str)",
     "a constant says quantity and limit"),
    (r"^\s*(?:///|//!)\s+(?:It|Its|They|Their|The same)\b[^.]{0,24}\.\s*$", "a doc comment's first line stands alone"),
]

# Genuine uses: path pattern, pattern in the normal form, reason. A hit that overlaps one is no hit.
GENUINE = [
    ("*", r"serde ?\([^)]*\b(?:rename|alias) = \"[^\"]*\"", "on-disk names stay"),
    ("*", r"\[\"[^\"]*\"\]", "keys of records on disk stay"),
    ("*", r"\"[\w ]+\" ?:", "keys of records on disk stay"),
    ("*", r"stream::new ?\(\"[^\"]*\"", "names of streams on disk stay"),
    ("*", r"column::data\(\"[^\"]*\"", "keys of columns on disk stay"),
    ("*", r"remesh\.weak", "a preset's key"),
    ("src/sim/vortex/flow/*", r"pub weak: f32|weak: defaults|params\.weak", "a preset's key"),
    ("tests/numerics/vortex_dynamics/*", r"remesh \{ [^}]*?weak: ", "a preset's key"),
    ("tests/cli/*", r"weak = [\d.]+", "a preset's key"),
    ("*", r"texts", "several texts"),
    ("src/import/*", r"pieces", "elements `Piece` of VTK's XML"),
    ("*", r"\.get\(\"[^\"]*\"", "keys of records on disk stay"),
    ("tests/*", r"\.sum\(\"[^\"]*\"", "keys of records on disk stay"),
    ("docs/*", r"`(?:caught|put back|told|rounds|lost)`", "keys of records on disk stay"),
    ("*", r"(?:one|two|three|four)[- ]way", "one-way and two-way coupling are the field's words"),
    ("*", r"by way of|under way|half ?-?way|all the way|(?:give|gives|gave|given|giving|make|makes) way|either way|the other way(?: round| about)?", "ordinary idiom"),
    ("*", r"(?:in|the) same way|(?:in|by) (?:this|that|which|some|any|no) way|in the way|out of the way|on the way|on (?:its|their) way|a long way", "ordinary idiom"),
    ("*", r"seeding lattices?|lattice boltzmann|(?:cubic|hexagonal|close[- ]packed|body[- ]centred|face[- ]centred|periodic) lattices?", "a lattice of seeded particles"),
    ("*", r"weak(?:er|est)? (?:coupling|form|solution|formulation|scaling)|weak ref|rc weak", "term of numerics or of Rust"),
    ("*", r"(?:right|left|two|one|single)[- ]handed(?:ness)?|handedness", "orientation"),
    ("*", r"hand[- ]written|by hand|at hand|on the other hand", "ordinary idiom"),
    ("*", r"that is to say|needless to say", "ordinary idiom"),
    ("*", r"carried (?:out|over)", "ordinary idiom"),
    ("*", r"(?:dam|plume|smoke|box|figure|in a|in the|the) room(?= of \d| with walls)", "a room in a scene"),
    ("*", r"dry[- ]run", "the option"),
    ("*", r"caught (?:by|in) (?:this|the|a) (?:test|check)|is caught by (?:a|the) (?:test|check)", "a test catches a fault"),
    ("*", r"it rounds|rounds (?:to|up|down|half|away|towards?|alike|differently|it)", "rounding of numbers"),
    ("*", r"least squares", "the method"),
    ("*", r"at (?:most|least) \(", "a bound in a sentence"),
    ("*", r"link condition|link[- ]time", "terms of mesh collapse and of compilers"),
    ("*", r"square roots?|per square|square metres?", "arithmetic"),
]

# Terms of the field and the files of which at least one must contain each: who greps for it is led there.
TERMS = [
    ("advect(?:s|ed|ion)", ["src/sim/vortex/flow/*.rs", "src/sim/smoke/*.rs"]),
    ("BVH", ["src/sim/sheet/contact/*.rs", "src/sdf/*.rs"]),
    ("broad phase", ["src/sim/sheet/contact/*.rs"]),
    ("narrow phase", ["src/sim/sheet/contact/*.rs"]),
    ("impact zone", ["src/sim/sheet/contact/*.rs"]),
    ("boundary particle|density map", ["src/sim/liquid/*.rs"]),
    ("time step", ["src/sim/*.rs", "src/sim/liquid/*.rs"]),
    ("residual", ["src/sim/sheet/implicit*.rs"]),
    ("preconditioner", ["src/sim/sheet/implicit*.rs"]),
    ("search direction", ["src/sim/sheet/implicit*.rs"]),
    ("source panel", ["src/sim/smoke/*.rs"]),
    ("method of images", ["src/sim/smoke/*.rs"]),
    ("remeshing", ["src/sim/vortex/flow/*.rs"]),
    ("redistribution", ["src/sim/vortex/flow/*.rs"]),
    ("half-edge", ["src/mesh/*.rs"]),
    ("connected component", ["src/mesh/*.rs"]),
    ("level set", ["src/sdf/*.rs", "src/mesh/*.rs"]),
    ("isosurface", ["src/mesh/*.rs"]),
    ("signed distance", ["src/sdf/*.rs"]),
    ("Hausdorff distance", ["src/mesh/*.rs"]),
]

MARKER = re.compile(r"^\s*(?:///|//!|//|#(?!\[))?\s?")
CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


class Normal:
    """A file's text in the normal form, with the line of each place."""

    def __init__(self, text):
        self.starts, parts, length = [], [], 0
        for line in text.splitlines():
            words = CAMEL.sub(" ", MARKER.sub("", line).replace("_", " ")).lower()
            words = re.sub(r"\s+", " ", words).replace("’", "'").strip() + " "
            self.starts.append(length)
            parts.append(words)
            length += len(words)
        self.text = "".join(parts)

    def line(self, place):
        return bisect.bisect_right(self.starts, place)


def matches(path, patterns):
    return any(fnmatch.fnmatch(path, pattern) for pattern in patterns)


def compiled(pattern):
    return re.compile(rf"(?<![\w])(?:{pattern})(?![\w])")


COMPILED = [(compiled(rule[0]), rule[1], rule[2] if len(rule) > 2 else ["*"]) for rule in RULES]
RAW_COMPILED = [(re.compile(pattern), instead) for pattern, instead in RAW_RULES]
GENUINE_COMPILED = [(glob, re.compile(pattern)) for glob, pattern, _ in GENUINE]


def hits(path, text):
    """(line, what was found, what to write instead) of a file, by line."""
    found = []
    for pattern, instead, globs in COMPILED:
        if matches(path, globs):
            name = Normal(path.rsplit(".", 1)[0].replace("/", " "))
            found += [(1, f"file name: {hit.group()}", instead) for hit in pattern.finditer(name.text)]
    normal = Normal(text)
    right = sorted(
        hit.span() for glob, pattern in GENUINE_COMPILED if fnmatch.fnmatch(path, glob) for hit in pattern.finditer(normal.text)
    )
    for pattern, instead, globs in COMPILED:
        if matches(path, globs):
            for hit in pattern.finditer(normal.text):
                if not any(start < hit.end() and hit.start() < end for start, end in right):
                    found.append((normal.line(hit.start()), hit.group().strip(), instead))
    if path.endswith(".rs"):
        before = ""
        for number, line in enumerate(text.splitlines(), 1):
            for pattern, instead in RAW_COMPILED:
                first = not before.lstrip().startswith(("///", "//!"))
                hit = pattern.search(line)
                if hit and (first or "stands alone" not in instead):
                    found.append((number, hit.group().strip(), instead))
            before = line
    return sorted(found)


def listed(paths):
    """Tracked and new files below `paths`, without what is ignored."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z", "--", *paths]
    names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split("\0")
    names = sorted({name for name in names if name and (ROOT / name).is_file()})
    # The corpus of tools/fuzz is no one's text.
    names = [name for name in names if not name.startswith("tools/fuzz/corpus/")]
    return [name for name in names if pathlib.Path(name).suffix in SUFFIXES and name not in SKIPPED]


def missing_terms():
    """The terms that no file of theirs contains."""
    names = listed(["src"])
    missing = []
    for term, globs in TERMS:
        texts = (re.sub(r"\s*\n\s*(?:///|//!|//)?\s*", " ", read(name)) for name in names if matches(name, globs))
        if not any(re.search(term, text, re.IGNORECASE) for text in texts):
            missing.append((term, globs))
    return missing


def read(name):
    return (ROOT / name).read_text(encoding="utf-8", errors="replace")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", action="store_true", help="print hits per folder and rule")
    parser.add_argument("paths", nargs="*", help="files or folders; all if none is given")
    args = parser.parse_args()

    paths = [str(pathlib.Path(path).resolve().relative_to(ROOT)) for path in args.paths]
    folders, rules, total = collections.Counter(), collections.Counter(), 0
    for name in listed(paths or SEARCHED):
        for line, found, instead in hits(name, read(name)):
            total += 1
            folders[str(pathlib.Path(name).parent)] += 1
            rules[instead] += 1
            if not args.count:
                print(f"{name}:{line}: {found} → {instead}")
    if args.count:
        for counts in (folders, rules):
            for key, count in sorted(counts.items(), key=lambda entry: -entry[1]):
                print(f"{count:6} {key}")
            print()
    missing = [] if args.paths else missing_terms()
    for term, globs in missing:
        print(f"missing term: {term} in {', '.join(globs)}")
    if total or missing:
        print(f"{total} hits, {len(missing)} missing terms", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
