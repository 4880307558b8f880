from .cloud_stage import cloud as cloud
from .inspection_stage import inspection as inspection
from .qdas_stage import qdas as qdas
from .qif_stage import qif as qif
from .sections_stage import sections as sections
