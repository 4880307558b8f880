from .csv_stage import csv as csv
from .write_stage import write as write
