"""Options of the verbs for recordings and models."""

from ...training.options import ClockShift as ClockShift
from ...training.options import DataFiles as DataFiles
from ...training.options import EvaluateOptions as EvaluateOptions
from ...training.options import ExportOptions as ExportOptions
from ...training.options import TrainOptions as TrainOptions
from ...twin.options import CordFamilyName as CordFamilyName
from ...twin.options import TwinOptions as TwinOptions
