/* A plant as the interface sees it: input u(k), output y(k). */
#ifndef RDPI_FMU_PLANT_H
#define RDPI_FMU_PLANT_H

#include <stdbool.h>
#include <stdint.h>

#include "rdpi_plant.h"

typedef rdpi_plant_state rdpi_fmu_model;

/* The displacement at rest, found with a copy: no sample has passed yet. */
static double rdpi_fmu_rest(rdpi_fmu_model *model)
{
    rdpi_fmu_model copy;
    rdpi_plant_init(model, &rdpi_plant_default);
    rdpi_plant_init(&copy, &rdpi_plant_default);
    return rdpi_plant_step(&copy, &rdpi_plant_default, RDPI_FMU_REST_V);
}

static void rdpi_fmu_first(rdpi_fmu_model *model, const double *input)
{
    (void)input;
    rdpi_plant_init(model, &rdpi_plant_default);
}

static double rdpi_fmu_sample(rdpi_fmu_model *model, const double *input, uint8_t *flags)
{
    const double displacement_um = rdpi_plant_step(model, &rdpi_plant_default, input[0]);
    *flags = (uint8_t)(*flags | rdpi_plant_flags(model));
    return displacement_um;
}

/* One of the flags by the place of its variable; false where there is none. */
static bool rdpi_fmu_flag(uint8_t flags, uint32_t place, bool *value)
{
    static const uint8_t bits[3] = {RDPI_CLAMPED, 0u, RDPI_OUT_OF_RANGE};
    if (place >= 3u || bits[place] == 0u) {
        return false;
    }
    *value = (flags & bits[place]) != 0u;
    return true;
}

#endif
