from .denoise_stage import denoise as denoise
from .read_stage import read as read
from .register_stage import register as register
