"""Write those parts of the documents that follow from the code.

config/README.md: the tables of keys, from the JSON schemas. docs/assumptions.md: the modelling
choices marked ``# ASSUME:`` in the code. With --check, only say whether the documents are up to
date (exit code 1 when not).
"""

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
# a comment that begins with ASSUME, and the comment lines that go on with it
ASSUMPTION = re.compile(r"# ASSUME: (.*(?:\n[ \t]*# (?!ASSUME).*)*)")


def keys(schema: dict, definitions: dict, prefix: str = "") -> Iterator[tuple[str, str, str]]:
    """Every key below `schema`: its full name, what it may be, and what it is."""
    for name, part in schema.get("properties", {}).items():
        node = resolve(part, definitions)
        yield f"{prefix}{name}", allowed(part, definitions), node.get("description", "")
        for branch in [node, *node.get("oneOf", [])]:
            yield from keys(resolve(branch, definitions), definitions, f"{prefix}{name}.")


def resolve(part: dict, definitions: dict) -> dict:
    if "$ref" not in part:
        return part
    target = definitions[part["$ref"].removeprefix("#/$defs/")]
    return target | {name: value for name, value in part.items() if name != "$ref"}


def allowed(part: dict, definitions: dict) -> str:
    """The values that a key may take, in words."""
    part = resolve(part, definitions)
    if "oneOf" in part:
        return " or ".join(allowed(branch, definitions) for branch in part["oneOf"])
    if "enum" in part:
        return ", ".join("null" if value is None else str(value) for value in part["enum"])
    kind = part["type"]
    kind = " or ".join(kind) if isinstance(kind, list) else kind
    kind = {"string": "text", "object": "section"}.get(kind, kind.replace("string", "text"))
    if kind == "array":
        if "maxItems" in part:
            inner = resolve(part["items"], definitions)
            what = "points" if inner.get("type") == "array" else "numbers"
            return f"list of {part['minItems']} {what}"
        return f"list of {allowed(part['items'], definitions)}"
    bounds = [
        f"{sign} {part[name]:g}"
        for name, sign in [
            ("exclusiveMinimum", ">"),
            ("minimum", "≥"),
            ("exclusiveMaximum", "<"),
            ("maximum", "≤"),
        ]
        if name in part
    ]
    return f"{kind} {', '.join(bounds)}".strip()


def table(schema: dict) -> str:
    rows = ["| key | value | what it is |", "|---|---|---|"]
    for name, values, description in keys(schema, schema.get("$defs", {})):
        rows.append(f"| `{name}` | {values} | {' '.join(description.split())} |")
    return "\n".join(rows)


def assumptions() -> Iterator[str]:
    """Every modelling choice marked in the code, by file."""
    for file in sorted([*ROOT.glob("src/**/*.py"), *ROOT.glob("workflow/scripts/*.py")]):
        for match in ASSUMPTION.finditer(file.read_text(encoding="utf-8")):
            text = " ".join(line.strip(" \t#") for line in match[1].splitlines())
            yield f"- {text} (`{file.relative_to(ROOT).as_posix()}`)"


def filled(document: str, parts: dict[str, str]) -> str:
    """The document with each part between its marks replaced."""
    for name, content in parts.items():
        start, end = f"<!-- {name}: made by `make docs` -->", f"<!-- end of {name} -->"
        before, rest = document.split(start)
        document = f"{before}{start}\n\n{content}\n\n{end}{rest.split(end)[1]}"
    return document


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    schemas = ROOT / "workflow" / "schemas"
    documents = {
        "config/README.md": {
            name: table(yaml.safe_load((schemas / f"{name}.schema.yaml").read_text("utf-8")))
            for name in ("config", "patches")
        },
        "docs/assumptions.md": {"assumptions": "\n".join(assumptions())},
    }
    stale = []
    for name, parts in documents.items():
        path = ROOT / name
        old = path.read_text(encoding="utf-8")
        new = filled(old, parts)
        if new != old:
            stale.append(name)
            if not check:
                path.write_text(new, encoding="utf-8")
    if check and stale:
        raise SystemExit(f"not up to date: {', '.join(stale)}; run `make docs`")


if __name__ == "__main__":
    main()
