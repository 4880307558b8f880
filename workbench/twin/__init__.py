"""Stages of the simulated cell, whose truth is known: `twin.part`, `twin.teach`, `twin.mill`, `twin.scan`."""

from workbench.twin.mill import mill
from workbench.twin.part import part
from workbench.twin.scan import scan
from workbench.twin.teach import teach

__all__ = ["mill", "part", "scan", "teach"]
