"""Mutation run: small wrong changes to the portable firmware; a test must detect each of them.

    python -m tests.firmware_bridge.mutation [--sample N] [--files guard.c,guard.h]

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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.firmware_bridge.cases import failure
from tests.firmware_bridge.rig import SOURCES, TRAP
from waychair.firmware_bridge.board import FIRMWARE

SURVIVORS = Path(__file__).with_name("survivors.txt")
MUTATED = ("axes.h", "safety_core.h", "safety_core.c", "guard.h", "guard.c", "frame.c", "protocol.c", "converter.c")
LONGEST_S = 40
"""A mutant that takes more of the processor's time hangs, which is noticed too."""

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


def mutants(firmware: Path = FIRMWARE) -> list[Mutant]:
    """All mutants in the order of files and lines."""
    found: list[Mutant] = []
    seen: Counter[tuple[str, str, str]] = Counter()
    for file in MUTATED:
        for number, line in enumerate((firmware / file).read_text().splitlines()):
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


def survives(mutant: Mutant, folder: Path, originals: dict[str, bytes]) -> str:
    """'killed', 'survived', 'same code' or 'not C' for one mutant; `originals` are the object files by source."""
    firmware = folder / "mutant"
    firmware.mkdir(exist_ok=True)
    for path in FIRMWARE.glob("*.[ch]"):
        lines = path.read_text().splitlines()
        if path.name == mutant.file:
            lines[mutant.line] = mutant.changed
        (firmware / path.name).write_text("\n".join(lines) + "\n")
    objects = compile_objects(firmware, folder, SOURCES if mutant.file.endswith(".h") else (mutant.file,))
    if objects is None:
        return "not C"
    if all(originals[name] == code for name, code in objects.items()):
        return "same code"
    library = folder / "mutant.so"
    for name, code in (originals | objects).items():
        (folder / f"{name}.o").write_bytes(code)
    files = [str(folder / f"{name}.o") for name in originals]
    subprocess.run(["cc", "-shared", *files, "-o", str(library)], check=True)
    return "survived" if _passes(library) else "killed"


def compile_objects(firmware: Path, folder: Path, sources: Sequence[str]) -> dict[str, bytes] | None:
    """Object code by source name; None when the compiler refuses it."""
    objects = {}
    for name in sources:
        path = Path(__file__).with_name(name) if name == "rig.c" else firmware / name
        target = folder / "object.o"
        command = ["cc", "-std=c99", "-O1", "-fPIC", *TRAP, f"-I{firmware}", "-c", str(path), "-o", str(target)]
        if subprocess.run(command, capture_output=True, check=False).returncode != 0:
            return None
        objects[name] = target.read_bytes()
    return objects


def run(chosen: Sequence[Mutant]) -> list[tuple[Mutant, str]]:
    """Return every mutant with its fate."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        originals = compile_objects(FIRMWARE, folder, (*SOURCES, "rig.c"))
        assert originals is not None, "the firmware itself does not compile"
        return [(mutant, survives(mutant, folder, originals)) for mutant in chosen]


def explained() -> dict[str, str]:
    """Mutants by name that may survive, with the reason: survivors.txt, each name above its indented reason."""
    reasons: dict[str, str] = {}
    name = ""
    for line in SURVIVORS.read_text().splitlines():
        if line.startswith(" "):
            reasons[name] = f"{reasons[name]} {line.strip()}".strip()
        elif line and not line.startswith("#"):
            name = line
            reasons[name] = ""
    return reasons


def _passes(library: Path) -> bool:
    """Whether all cases pass, in a separate process: a mutant may crash or never end."""
    child = os.fork()
    if child == 0:
        signal.setitimer(signal.ITIMER_PROF, LONGEST_S)  # not by the clock: other programs may run beside it
        faulthandler.disable()  # a crash is an answer, and needs no report
        passed = False
        try:
            passed = failure(library) == ""
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
    arguments = parser.parse_args()
    files = tuple(arguments.files.split(",")) if arguments.files else MUTATED
    everything = [mutant for mutant in mutants() if mutant.file in files]
    chosen = random.Random(0).sample(everything, arguments.sample) if arguments.sample else everything
    results = run(chosen)
    reasons = explained()
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
