"""Break the core on purpose, one operator at a time, and see a test fail each time: `make mutants`.

mutmut makes and tries the mutants; which modules and which tests is said in pyproject.toml. Each mutant that no
test kills must stand in tests/survivors.toml with the reason why it may live. Exits with 1 if one does not, or
if one stands there that was killed or cannot be made any more.

`python tests/mutants.py [MUTMUT ARGUMENT ...]`
"""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

EXPLAINED = Path(__file__).with_name("survivors.toml")
ALIVE = (0, 33, None)  # mutmut's exit codes: all tests passed, there is no test, not tried
MADE = re.compile(r"(?P<place>.+?)__mutmut_\d+$")


def survivors() -> dict[str, str]:
    """Return the mutants that no test killed, with what was changed, by mutmut's names."""
    alive = {}
    for file in sorted(Path("mutants/haptigraph").rglob("*.py.meta")):
        codes = json.loads(file.read_text())["exit_code_by_key"]
        alive |= {name: changed(name) for name, code in codes.items() if code in ALIVE}
    return alive


def changed(name: str) -> str:
    """Return a mutant as "module.Class.function: removed lines -> added lines"."""
    show = subprocess.run([sys.executable, "-m", "mutmut", "show", name], capture_output=True, text=True)
    lines = [line for line in show.stdout.splitlines() if not line.startswith(("---", "+++"))]
    removed, added = (" ".join(line[1:].strip() for line in lines if line.startswith(mark)) for mark in "-+")
    place = MADE.sub(r"\g<place>", name).removeprefix("haptigraph.")
    return f"{re.sub(r'x?ǁ', '.', place).replace('.x_', '.').replace('..', '.')}: {removed} -> {added}"


def main() -> int:
    """Run mutmut and compare its survivors with those explained."""
    if subprocess.run([sys.executable, "-m", "mutmut", "run", *sys.argv[1:]]).returncode:
        return 1
    explained = {
        mutant: group["because"]
        for group in tomllib.loads(EXPLAINED.read_text(encoding="utf-8"))["explained"]
        for mutant in group["mutants"]
    }
    alive = set(survivors().values())
    for mutant in sorted(alive - explained.keys()):
        print(f"survived: {mutant}")
    for mutant in sorted(explained.keys() - alive):
        print(f"explained, but it does not survive: {mutant}")
    print(f"{len(alive)} mutants survived, {len(alive & explained.keys())} of them explained")
    return 1 if alive ^ explained.keys() else 0


if __name__ == "__main__":
    sys.exit(main())
