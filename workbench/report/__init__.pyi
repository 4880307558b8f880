from .closed_loop_stage import closed_loop as closed_loop
from .correction_stage import correction as correction
from .groove_stage import groove as groove
from .groove_stage import preparation as preparation
from .html_stage import html as html
from .inspection_stage import inspection as inspection
from .plan_stage import plan as plan
from .sensitivity_stage import sensitivity as sensitivity
