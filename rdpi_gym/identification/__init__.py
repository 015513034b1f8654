"""Identification of RDPI plants from measured records (Eq. 9, 10)."""

from rdpi_gym.identification.fitting import MIN_MOTION, FitResult, fit, interval_95
from rdpi_gym.identification.residuals import (
    RecordResidual,
    pooled_rmse,
    simulate_record,
    validation_rmse,
)

__all__ = [
    "MIN_MOTION",
    "FitResult",
    "RecordResidual",
    "fit",
    "interval_95",
    "pooled_rmse",
    "simulate_record",
    "validation_rmse",
]
