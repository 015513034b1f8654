"""What is wrong with records before any model is asked: found, counted, said, left out."""

from rdpi_gym.diagnosis.hygiene.finding import Finding
from rdpi_gym.diagnosis.hygiene.inspection import Inspected, inspect
from rdpi_gym.diagnosis.hygiene.limits import limits

__all__ = ["Finding", "Inspected", "inspect", "limits"]
