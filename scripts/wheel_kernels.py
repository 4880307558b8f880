"""The build hook: with WORKBENCH_KERNELS=FOLDER a wheel brings these kernels, and is one Python's and one platform's.

Without it the wheel is the same everywhere. An index may hold both: pip takes the one that fits best.
"""

import os
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class WheelKernels(BuildHookInterface):  # type: ignore[misc]
    """Adds the folder of `scripts/compile_kernels.py --into FOLDER`."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """What hatchling calls before it collects files."""
        kernels = os.environ.get("WORKBENCH_KERNELS")
        if kernels and version == "standard":
            build_data["force_include"][os.path.abspath(kernels)] = "workbench/shipped/kernels"
            build_data["pure_python"], build_data["infer_tag"] = False, True
