"""What to scan next, of a part that is undecided: the stage `scan.next`, which imports the planning only then."""

from workbench.scan_next.proposal import next_

__all__ = ["next_"]
