"""Mutation run: small wrong changes to the portable firmware; a test must detect each of them.

    python -m tests.firmware_bridge.mutation [--glove] [--sample N] [--files guard.c,guard.h]

After the method of panda's and opendbc's safety tests: comparisons, boundaries, arithmetic, logic, negations, numbers
and whole statements are changed one at a time, and `cases.py` runs against each mutant. A mutant whose object code is
the original's is no change. All others that survive must stand in `survivors.txt` with the reason why they are no
fault; an explanation of a mutant that is killed, or is no more, is an error too.
"""

from __future__ import annotations

import argparse
import faulthandler
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.firmware_bridge import cases
from tests.firmware_bridge.glove import cases as glove_cases
from tests.firmware_bridge.glove import rig as glove_rig
from tests.firmware_bridge.rig import SOURCES, TRAP
from waychair.firmware_bridge.board import FIRMWARE

LONGEST_S, WAITED_S = 40, 300
"""s; a mutant that takes more of the processor's time, or more by the clock, hangs, which is noticed too."""

SWAPS = (
    (r"(?<![<-])<(?![<=])", "<="),
    (r"<=", "<"),
    (r"(?<![->])>(?![>=])", ">="),
    (r">=", ">"),
    (r"==", "!="),
    (r"!=", "=="),
    (r"&&", "||"),
    (r"\|\|", "&&"),
    (r" \+ ", " - "),
    (r" - ", " + "),
    (r" \* ", " + "),
    (r"!(?=[a-z(])", ""),
    (r"\btrue\b", "false"),
    (r"\bfalse\b", "true"),
    (r"\|=", "="),
    (r" & ~", " & "),
)
STATEMENT = re.compile(r"^\s+[a-z(][\w\->\[\].() ,&*+]*( [|+-]?= .*|\(.*\)|\+\+);\s*(/\*.*)?$")
"""A whole line that assigns or calls; declarations begin with a type, and leaving one out would not compile."""

DECLARATION = re.compile(
    r"^\s+(const |static |return|bool |u?int\d+_t |safety_|guard \*|span |frame |size_t |line_holder |for )"
)
NUMBER = re.compile(r"(?<![\w.])\d+(?![\w.])")


@dataclass(frozen=True, slots=True)
class Target:
    """Portable firmware of one board: its mutated files and all its sources below `FIRMWARE`, its rig and its cases."""

    mutated: tuple[str, ...]
    sources: tuple[str, ...]
    rig: Path
    failure: Callable[[Path], str]
    survivors: Path
    flags: tuple[str, ...] = ()


HERE = Path(__file__).parent
CHAIR = Target(
    ("axes.h", "safety_core.h", "safety_core.c", "guard.h", "guard.c", "frame.c", "protocol.c", "converter.c"),
    SOURCES,
    HERE / "rig.c",
    cases.failure,
    HERE / "survivors.txt",
)
GLOVE = Target(
    ("glove/glove_core.h", "glove/glove_core.c", "glove/glove_protocol.c", "glove/glove_board.c"),
    glove_rig.SOURCES,
    glove_rig.RIG,
    glove_cases.failure,
    HERE / "glove" / "survivors.txt",
    (glove_rig.LIMIT,),
)


@dataclass(frozen=True, slots=True)
class Mutant:
    """One changed line of one file; `occurrence` counts the same change of an equal line, from 1."""

    file: str
    line: int
    original: str
    changed: str
    occurrence: int

    def name(self) -> str:
        """Its name in survivors.txt, independent of its line."""
        again = f" ({self.occurrence})" if self.occurrence > 1 else ""
        return f"{self.file}: {_bare(self.original)}  =>  {_bare(self.changed) or 'nothing'}{again}"


def mutants(target: Target = CHAIR) -> list[Mutant]:
    """All mutants in the order of files and lines."""
    found: list[Mutant] = []
    seen: Counter[tuple[str, str, str]] = Counter()
    for file in target.mutated:
        for number, line in enumerate((FIRMWARE / file).read_text().splitlines()):
            code = line.split("/*")[0]
            if not code.startswith((" ", "static const")) or code.strip().startswith("*"):
                continue
            for change in dict.fromkeys(_changes(code, header=file.endswith(".h"))):
                changed = change + line[len(code) :]
                seen[file, _bare(line), _bare(changed)] += 1
                found.append(Mutant(file, number, line, changed, seen[file, _bare(line), _bare(changed)]))
    return found


def _changes(code: str, header: bool) -> Iterator[str]:
    if header:  # of the header only the limits; its other numbers are bits and layouts, which have their own tests
        if re.match(r"^    [A-Z_]+ = (\d+|[A-Z_]+ - [A-Z_]+),?\s*$", code):
            for match in NUMBER.finditer(code):
                for other in (int(match[0]) - 1, int(match[0]) + 1):
                    yield code[: match.start()] + str(other) + code[match.end() :]
        return
    for pattern, swapped in SWAPS:
        for match in re.finditer(pattern, code):
            yield code[: match.start()] + swapped + code[match.end() :]
    for match in NUMBER.finditer(code):
        yield code[: match.start()] + str(int(match[0]) + 1) + code[match.end() :]
    if STATEMENT.match(code) and not DECLARATION.match(code):
        yield re.match(r"\s*", code)[0] + ";"  # type: ignore[index]


def survives(mutant: Mutant, folder: Path, originals: dict[str, bytes], target: Target = CHAIR) -> str:
    """'killed', 'survived', 'same code' or 'not C' for one mutant; `originals` are the object files by source."""
    firmware = folder / "mutant"
    for path in (*FIRMWARE.glob("*.[ch]"), *FIRMWARE.glob("glove/*.[ch]")):
        name = str(path.relative_to(FIRMWARE))
        lines = path.read_text().splitlines()
        if name == mutant.file:
            lines[mutant.line] = mutant.changed
        (firmware / name).parent.mkdir(parents=True, exist_ok=True)
        (firmware / name).write_text("\n".join(lines) + "\n")
    changed = target.sources if mutant.file.endswith(".h") else (mutant.file,)
    objects = compile_objects([firmware / name for name in changed], firmware, folder, target.flags)
    if objects is None:
        return "not C"
    if all(originals[name] == code for name, code in objects.items()):
        return "same code"
    library = folder / "mutant.so"
    for name, code in (originals | objects).items():
        (folder / f"{name}.o").write_bytes(code)
    files = [str(folder / f"{name}.o") for name in originals]
    subprocess.run(["cc", "-shared", *files, "-o", str(library)], check=True)
    return "survived" if _passes(library, target) else "killed"


def compile_objects(
    sources: Sequence[Path], firmware: Path, folder: Path, flags: Sequence[str] = ()
) -> dict[str, bytes] | None:
    """Object code by the names of the sources; None when the compiler refuses it."""
    objects = {}
    for path in sources:
        target = folder / "object.o"
        command = ["cc", "-std=c99", "-O1", "-fPIC", *TRAP, *flags, f"-I{firmware}", "-c", str(path), "-o", str(target)]
        if subprocess.run(command, capture_output=True, check=False).returncode != 0:
            return None
        objects[path.name] = target.read_bytes()
    return objects


def run(chosen: Sequence[Mutant], target: Target = CHAIR) -> list[tuple[Mutant, str]]:
    """Return every mutant with its fate."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sources = [*(FIRMWARE / source for source in target.sources), target.rig]
        originals = compile_objects(sources, FIRMWARE, folder, target.flags)
        assert originals is not None, "the firmware itself does not compile"
        return [(mutant, survives(mutant, folder, originals, target)) for mutant in chosen]


def explained(target: Target = CHAIR) -> dict[str, str]:
    """Mutants by name that may survive, with the reason: survivors.txt, each name above its indented reason."""
    reasons: dict[str, str] = {}
    name = ""
    for line in target.survivors.read_text().splitlines():
        if line.startswith(" "):
            reasons[name] = f"{reasons[name]} {line.strip()}".strip()
        elif line and not line.startswith("#"):
            name = line
            reasons[name] = ""
    return reasons


def _passes(library: Path, target: Target) -> bool:
    """Whether all cases pass, in a separate process: a mutant may crash or never end."""
    child = os.fork()
    if child == 0:
        signal.setitimer(signal.ITIMER_PROF, LONGEST_S)  # not by the clock: other programs may run beside it
        signal.alarm(WAITED_S)  # but a forked process that waits for a lock uses no processor
        faulthandler.disable()  # a crash is an answer, and needs no report
        passed = False
        try:
            passed = target.failure(library) == ""
        finally:
            os._exit(0 if passed else 1)
    return os.waitpid(child, 0)[1] == 0


def _bare(line: str) -> str:
    code = " ".join(line.split("/*")[0].split())
    return "" if code == ";" else code


def main() -> int:
    """Run and print the survivors; status 1 when a survivor has no explanation, or an explanation no survivor."""
    parser = argparse.ArgumentParser(description="Mutation run over the portable firmware")
    parser.add_argument("--sample", type=int, help="only so many mutants, drawn with a fixed seed")
    parser.add_argument("--files", default="", help="only the mutants of these files, by comma")
    parser.add_argument("--glove", action="store_true", help="the glove's firmware, not that of the chair's board")
    arguments = parser.parse_args()
    target = GLOVE if arguments.glove else CHAIR
    files = tuple(arguments.files.split(",")) if arguments.files else target.mutated
    everything = [mutant for mutant in mutants(target) if mutant.file in files]
    chosen = random.Random(0).sample(everything, arguments.sample) if arguments.sample else everything
    results = run(chosen, target)
    reasons = explained(target)
    survivors = [mutant.name() for mutant, fate in results if fate == "survived"]
    counts = {fate: sum(f == fate for _, f in results) for fate in ("killed", "survived", "same code", "not C")}
    print(f"{len(results)} mutants: " + ", ".join(f"{count} {fate}" for fate, count in counts.items()))
    unexplained = [name for name in survivors if name not in reasons]
    whole = not arguments.sample and not arguments.files
    stale = [name for name in reasons if name not in survivors] if whole else []
    for name in unexplained:
        print(f"no test notices   {name}")
    for name in stale:
        print(f"explained in vain   {name}")
    return 1 if unexplained or stale else 0


if __name__ == "__main__":
    sys.exit(main())
