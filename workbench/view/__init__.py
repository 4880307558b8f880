"""The report with its 3-D and the other results of a run, served to a browser on this machine."""

from workbench.view.server import ResultServer, address_of, serve

__all__ = ["ResultServer", "address_of", "serve"]
