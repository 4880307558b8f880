"""`workbench look`: any recording, cloud or vendor's file as it lies in the base, and what can be said against it."""

from workbench.look.command import look

__all__ = ["look"]
