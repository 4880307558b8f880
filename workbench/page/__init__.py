"""`workbench open`: one page in the browser, for looking at recordings, running pipelines and finding old results."""

from workbench.page.app import serve

__all__ = ["serve"]
