from .gate_stage import gate as gate
from .groove_stage import groove as groove
from .groove_stage import groove_gate as groove_gate
from .groove_stage import preparation as preparation
from .sections_stage import sections as sections
