/* What this model is: its numbers for the interface. */
#ifndef RDPI_FMU_MODEL_H
#define RDPI_FMU_MODEL_H

#define RDPI_FMU_TOKEN "@TOKEN@"
#define RDPI_FMU_TS_S @TS@
#define RDPI_FMU_REST_V (@REST@)
#define RDPI_FMU_START (@START@)
#define RDPI_FMU_INPUTS @INPUTS@u

#include "rdpi_fmu_@KIND@.h"

#endif
