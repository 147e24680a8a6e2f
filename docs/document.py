"""Write the parts of the documents that are generated from the code.

In docs/reference: tables.md, the columns of every table of results, from their schema; choices.md,
the modelling choices marked ``# ASSUME:`` in the code, by stage; cli.md, the output of
`gst --help`. config/README.md: the tables of keys, from `gstlib.settings` and the JSON schemas.
With --check, write nothing, and end with exit code 1 if one of them is out of date.
"""

import argparse
import itertools
import re
from collections.abc import Iterator
from pathlib import Path

import click
import yaml

from gst.cli import main as gst
from gst.config.tables import TABLES
from gstlib.settings import json_schema

ROOT = Path(__file__).parents[1]
# A comment that begins with ASSUME, and the comment lines that continue it.
ASSUMPTION = re.compile(r"# ASSUME: (.*(?:\n[ \t]*# (?!ASSUME).*)*)")
# Its parts. A title is a noun phrase of a few words.
PARTS = re.compile(
    r"(?P<title>[A-Z0-9](?:(?!\. ).){1,79})\. (?P<choice>.+?\.)"
    r" Reason: (?P<reason>.+?\.\)?)(?: Alternative: (?P<alternative>.+\.))?"
)

# The stages, in the order of the work: a module's folder, or its own name where it lies in none.
STAGES = {
    "preprocess": "Mesh and scans",
    "macroscale": "Macroscale contact",
    "coupling": "From the square to its patches",
    "microscale": "Microscale contact",
    "change": "Change from T0 to T1",
    "use": "How the tool was used",
    "wear": "Wear",
    "validation": "Comparison with the measured loss",
    "specimen": "Synthetic specimen",
    "contact": "Contact in general",
    "surfaces": "Surfaces and files",
    "checks": "Checks",
}
STAGE_OF = {"conditions": "contact", "bem": "contact", "io": "surfaces"}

# Characters of a line of help.
WIDTH = 110
SIGNS = {
    "exclusiveMinimum": ">",
    "minimum": "≥",
    "exclusiveMaximum": "<",
    "maximum": "≤",
}


def keys(node: dict, prefix: str = "") -> Iterator[tuple[str, str, str, str]]:
    """Every key below `node`: its full name, possible values, default and description."""
    for name, part in node.get("properties", {}).items():
        default = "required" if name in node.get("required", []) else default_of(part)
        yield f"{prefix}{name}", allowed(part), default, part.get("description", "")
        yield from keys(part, f"{prefix}{name}.")


def default_of(node: dict) -> str:
    """The default in short YAML; empty where there is none but those of a section's keys."""
    match node.get("default", {}):
        case {}:
            return ""
        case [first, *_]:
            return f"[{default_of({'default': first})}, …]"
        case value:
            return yaml.safe_dump(value, default_flow_style=True).splitlines()[0]


def allowed(node: dict) -> str:
    """The values that a key may take, in words."""
    if "enum" in node:
        values = ("null" if value is None else value for value in node["enum"])
        return ", ".join(map(str, values))
    kinds = node["type"] if isinstance(node["type"], list) else [node["type"]]
    kind = " or ".join(
        {"string": "text", "object": "section"}.get(kind, kind) for kind in kinds
    )
    if kind == "array":
        count = f"{node['minItems']} " if "maxItems" in node else ""
        return f"list of {count}" + re.sub(r"^(\w+)", r"\1s", allowed(node["items"]))
    bounds = [f"{sign} {node[name]:g}" for name, sign in SIGNS.items() if name in node]
    return f"{kind} {', '.join(bounds)}".strip()


def table(schema: dict) -> str:
    rows = ["| key | value | default | meaning |", "|---|---|---|---|"]
    for name, values, default, description in keys(schema):
        rows.append(
            f"| `{name}` | {values} | {default} | {' '.join(description.split())} |"
        )
    return "\n".join(rows)


def choices() -> Iterator[str]:
    """Every modelling choice marked in the code, by stage."""
    listed = {stage: [f"## {title}", ""] for stage, title in STAGES.items()}
    files = *ROOT.glob("src/**/*.py"), *ROOT.glob("workflow/scripts/*.py")
    for file in sorted(files):
        name = file.relative_to(ROOT).as_posix()
        for match in ASSUMPTION.finditer(file.read_text("utf-8")):
            text = " ".join(line.strip(" \t#") for line in match[1].splitlines())
            listed[stage_of(name)].append(f"- {choice_of(text, name)} (`{name}`)")
    for lines in listed.values():
        if len(lines) > 2:
            yield "\n".join(lines)


def choice_of(text: str, name: str) -> str:
    """A choice in Markdown, from the text of its comment in the module `name`."""
    parts = PARTS.fullmatch(text)
    if parts is None or "ASSUME:" in text:
        raise SystemExit(
            f"{name}: '# ASSUME: {text[:60]}…' is not of the form 'Title. Choice. Reason: "
            "Sentence. Alternative: Sentence.'; the alternative may be left out"
        )
    title, choice, reason, alternative = parts.groups()
    other = f" *Alternative:* {alternative}" if alternative else ""
    return f"**{title}.** {choice} *Reason:* {reason}{other}"


def stage_of(name: str) -> str:
    """The stage to which a module belongs; a module of the application belongs to the checks."""
    package, _, rest = name.removeprefix("src/").partition("/")
    room = rest.partition("/")[0].removesuffix(".py")
    return STAGE_OF.get(room, room) if package == "gstlib" else "checks"


def commands() -> Iterator[str]:
    """The output of `gst --help`, and the help of each command without its option ``--help``."""
    group = click.Context(
        gst, info_name="gst", terminal_width=WIDTH, **gst.context_settings
    )
    yield gst.get_help(group)
    for name, command in gst.commands.items():
        text = command.get_help(click.Context(command, info_name=name, parent=group))
        yield re.sub(r"\n  -h, --help .*", "", text)


def results() -> Iterator[str]:
    """The tables of results by stage, each with its columns."""
    for stage, listed in itertools.groupby(TABLES.values(), lambda one: one.stage):
        yield f"## {stage}"
        for one in listed:
            only = f" ({one.only})" if one.only else ""
            yield f"### `{one.file}`: {one.title}{only}"
            rows = ["| column | unit | meaning |", "|---|---|---|"]
            for name, column in one.columns.items():
                key = "**" if name in one.key else ""
                maybe = " (not always there)" if column.optional else ""
                rows.append(
                    f"| {key}`{name}`{key} | {column.unit} | {column.meaning}{maybe} |"
                )
            yield "\n".join(rows)


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
    schemas = {"config": json_schema()}
    for name in ("patches", "poses", "published"):
        text = (ROOT / f"workflow/schemas/{name}.schema.yaml").read_text("utf-8")
        schemas[name] = yaml.safe_load(text)
    documents = {
        "config/README.md": {name: table(each) for name, each in schemas.items()},
        "docs/reference/tables.md": {"tables": "\n\n".join(results())},
        "docs/reference/choices.md": {"choices": "\n\n".join(choices())},
        "docs/reference/cli.md": {
            "commands": "```\n" + "\n\n".join(commands()) + "\n```"
        },
    }
    stale = []
    for name, parts in documents.items():
        old = (ROOT / name).read_text("utf-8")
        new = filled(old, parts)
        if check and new != old:
            stale.append(name)
        elif new != old:
            (ROOT / name).write_text(new, encoding="utf-8")
    if stale:
        raise SystemExit(f"out of date: {', '.join(stale)}; run `make docs`")


if __name__ == "__main__":
    main()
