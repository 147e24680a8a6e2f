"""What was tried and what came of it, as the table of docs/faults.md."""

from dataclasses import dataclass, field


@dataclass
class Count:
    """Of one kind of fault: how often it was tried, and what was amiss each time it was lost."""

    fault: str
    tried: int = 0
    lost: list[str] = field(default_factory=list)

    def add(self, amiss: str = "") -> None:
        self.tried += 1
        if amiss:
            self.lost.append(amiss)
        print(f"  {self.fault}: {'LOST: ' + amiss if amiss else 'survived'}", flush=True)


def table(counts: list[Count]) -> str:
    rows = [("fault", "tried", "survived", "lost")]
    rows += [(c.fault, c.tried, c.tried - len(c.lost), len(c.lost)) for c in counts]
    tried, lost = (sum(row[i] for row in rows[1:]) for i in (1, 3))
    rows.append(("all", tried, tried - lost, lost))
    lines = ["| " + " | ".join(map(str, row)) + " |" for row in rows]
    return "\n".join([lines[0], "|---|---|---|---|", *lines[1:]])
