"""Record where the study's results come from, and what they are.

Inputs: every file that the study was made from; the page; every figure and table that is packed
with it, and their captions. Outputs: the record; the contents: of the page and each of the others
file, category, title, caption (HTML) and SHA-256. Settings: the category and the title of each
figure and table; the whole config; the commit and the hash of the program.
"""

import json
from pathlib import Path

from gst.logs import run_script
from gst.page import caption_html
from gst.provenance import sha256, study_provenance
from gstlib.io.files import write_whole

PAGE = "0 Overview", "the page of the study"
WHAT = (
    "The answer, the tool in 3D, all warnings, a card for each patch, every figure and table."
)


def main(
    files: list[Path],
    page: Path,
    packed: list[Path],
    captions: list[Path],
    record: Path,
    contents: Path,
    *,
    titles: list[list[str]],
    config: dict,
    commit: str | None,
    program: str,
) -> None:
    said = [caption_html(caption.read_text("utf-8"), config=config) for caption in captions]
    files_of = zip([page, *packed], [PAGE, *titles], [WHAT, *said], strict=True)
    entries = []
    for file, (category, title), caption in files_of:
        name = file.relative_to(contents.parent).as_posix()
        entry = {"file": name, "category": category, "title": title, "caption": caption}
        entries.append(entry | {"sha256": sha256(file)})
    made_from = study_provenance(config, files, commit, program)
    for target, content in ((record, made_from), (contents, entries)):
        text = json.dumps(content, indent=1, ensure_ascii=False)
        write_whole(target, f"{text}\n".encode())


if "snakemake" in globals():
    run_script(snakemake, main)
