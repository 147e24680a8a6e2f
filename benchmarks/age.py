"""How old are the rows in results/: were they made by the program as it stands?

    python benchmarks/age.py

says so, and writes it into docs/explanation/evidence.md. Each benchmark notes in results/made.json
what its rows are, and which program made them: by the modules of the library that it imports, or by
all of the program if it runs whole studies. Comments, docstrings and messages may change.
"""

import json
from pathlib import Path

from gst.run.provenance import library_hash, program_hash
from gstlib.io.files import sha256, write_whole

HERE = Path(__file__).parent
MADE = HERE / "results/made.json"
EVIDENCE = HERE.parent / "docs/explanation/evidence.md"
BEGIN, END = "<!-- age: begin -->\n", "<!-- age: end -->\n"
# The files of rows. A script has the name of its rows, apart from these; those that run whole
# studies by the workflow have all of the program.
_NAMES = """hertz-256 hertz-512 rough-22 rough-76 path-22 path-76 periodic-76 periodic-2000 growth
transforms statistics_of_contact registration finding placement chance two_scales left_out strikes
power power_correlated verdict verdict_correlated correlated use false_stops
repeats breech_faces margin scale"""
NAMES = _NAMES.split()
SCRIPTS = dict.fromkeys(["repeats", "breech_faces"], "measured_surfaces")
# Rows of stones whose errors correlate, by the script of the rows without.
CORRELATED = "_correlated"
OF_SOLVER, SOLVER = NAMES[: NAMES.index("transforms")], ["codes/run_gstlib", "problems"]
# What several of the scripts import.
SHARED = "strikes", "problems", "specimens"
OF_PROGRAM = "margin", "scale"
SEVERAL = "several"  # programs made the rows


def record(rows, *, adds=False):
    """Note that the program as it stands made these rows; or some of them, if it `adds`."""
    if rows.parent.resolve() != MADE.parent.resolve():
        return
    made = read()
    now = _program(rows.stem)
    before = made.get(rows.stem, {}).get("program")
    program = SEVERAL if adds and before not in (None, now) else now
    made[rows.stem] = {"program": program, "rows": sha256(rows)[:16]}
    write_whole(MADE, json.dumps(made, indent=2, sort_keys=True).encode() + b"\n")


def read():
    """What results/made.json says, by the name of a file of rows."""
    return json.loads(MADE.read_text(encoding="utf-8")) if MADE.exists() else {}


def _program(name):
    if name in OF_PROGRAM:
        return program_hash()
    scripts = SOLVER
    if name not in OF_SOLVER:
        own = SCRIPTS.get(name, name.removesuffix(CORRELATED))
        text = (HERE / f"{own}.py").read_text(encoding="utf-8")
        scripts = [own, *(other for other in SHARED if f"from {other} import" in text)]
    return "".join(library_hash(HERE / f"{script}.py") for script in scripts)


def ages():
    """Which rows the program as it stands made, and which an earlier one: a line for each."""
    made = read()
    now = [
        name for name in NAMES if made.get(name, {}).get("program") == _program(name)
    ]
    earlier = [name for name in NAMES if name not in now]
    parts = {
        "Made by the program as it stands": now,
        "Made by an earlier version of the program": earlier,
    }
    return "\n".join(
        f"- {what}: {', '.join(f'`{name}.csv`' for name in names)}."
        for what, names in parts.items()
        if names
    )


def main():
    text = EVIDENCE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    write_whole(EVIDENCE, f"{before}{BEGIN}\n{ages()}\n\n{END}{after}".encode())
    print(ages())


if __name__ == "__main__":
    main()
