"""Templates of the project's packages (jinja2's): what they are compiled to is kept, since compiling takes longest.

jinja2 itself costs time to import: it comes with the first template.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from workbench.user_folder import folder, forget

if TYPE_CHECKING:
    from jinja2 import Environment

KEPT = "template-1-%s.kept"  # sources are known by their digest, the options below are not: another number with them


def environment(package: str, **options: Any) -> Environment:
    """The templates of a package; every value is escaped. `options`: jinja2's, of what is done when they are filled."""
    from jinja2 import Environment, FileSystemBytecodeCache, PackageLoader, StrictUndefined
    from jinja2.bccache import Bucket

    class Kept(FileSystemBytecodeCache):
        def load_bytecode(self, bucket: Bucket) -> None:
            try:
                super().load_bytecode(bucket)
            except Exception:  # whatever unpickling makes of a damaged file: it is made again
                bucket.reset()

    where = folder().path
    forget("template-*.kept")
    return Environment(
        loader=PackageLoader(package, ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=Kept(str(where), KEPT) if where else None,
        **options,
    )
