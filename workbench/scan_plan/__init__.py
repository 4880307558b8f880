"""Planning a scan: from where a bevel will be known well enough. Stages `scan.plan`, `scan.program`."""

from workbench.artefacts.showing import shown_all
from workbench.scan_plan.plan_stage import ScanPass, ScanPlan, plan
from workbench.scan_plan.program_stage import program

__all__ = ["ScanPass", "ScanPlan", "plan", "program"]

shown_all(ScanPass, ScanPlan)
del shown_all
