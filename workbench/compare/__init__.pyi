from .deviation_stage import deviation as deviation
from .register_stage import register as register
from .repeatability_stage import repeatability as repeatability
from .study_stage import study as study
from .surface_stage import mesh as mesh
from .surface_stage import plan as plan
from .surface_stage import surface as surface
