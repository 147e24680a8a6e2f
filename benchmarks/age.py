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
# What measures: for each file of rows, the scripts that import what made them; none if all did.
_SOLVER = ("codes/run_gstlib.py", "problems.py")
SCRIPTS = {
    **dict.fromkeys(("hertz-256", "hertz-512", "rough-22", "rough-76"), _SOLVER),
    **dict.fromkeys(
        ("path-22", "path-76", "periodic-76", "periodic-2000", "growth"), _SOLVER
    ),
    "transforms": ("transforms.py", "problems.py"),
    "statistics_of_contact": ("statistics_of_contact.py",),
    "registration": ("registration.py",),
    "finding": ("finding.py", "specimens.py"),
    "placement": ("placement.py", "specimens.py"),
    "chance": ("chance.py",),
    "two_scales": ("two_scales.py", "specimens.py"),
    "left_out": ("left_out.py", "strikes.py", "specimens.py"),
    "strikes": ("strikes.py", "specimens.py"),
    "power": ("power.py", "specimens.py"),
    "power_inferred": ("power.py", "specimens.py"),
    "verdict": ("verdict.py", "specimens.py"),
    "use": ("use.py", "specimens.py"),
    "false_stops": ("false_stops.py", "specimens.py"),
    "repeats": ("measured_surfaces.py", "specimens.py"),
    "breech_faces": ("measured_surfaces.py", "specimens.py"),
    "margin": (),
    "scale": (),
}
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
    scripts = SCRIPTS[name]
    return "".join(library_hash(HERE / script) for script in scripts) or program_hash()


def ages():
    """Which rows the program as it stands made, and which an earlier one: a line for each."""
    made = read()
    now = [
        name for name in SCRIPTS if made.get(name, {}).get("program") == _program(name)
    ]
    earlier = [name for name in SCRIPTS if name not in now]
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
