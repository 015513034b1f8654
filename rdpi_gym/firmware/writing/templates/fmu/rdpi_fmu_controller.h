/* A controller as the interface sees it: inputs r(k), y(k), r(k+1) ...; output u(k+1). */
#ifndef RDPI_FMU_CONTROLLER_H
#define RDPI_FMU_CONTROLLER_H

#include <stdbool.h>
#include <stdint.h>

#include "rdpi_controller.h"

typedef rdpi_controller_state rdpi_fmu_model;

static double rdpi_fmu_rest(rdpi_fmu_model *model)
{
    rdpi_controller_init(model, &rdpi_controller_default, RDPI_FMU_START);
    return RDPI_FMU_REST_V;
}

/* The memory begins at the reference of the first sample. */
static void rdpi_fmu_first(rdpi_fmu_model *model, const double *input)
{
    rdpi_controller_init(model, &rdpi_controller_default, input[0]);
}

static double rdpi_fmu_sample(rdpi_fmu_model *model, const double *input, uint8_t *flags)
{
    const double command_V
        = rdpi_controller_step(model, &rdpi_controller_default, input[0], &input[2], input[1]);
    *flags = (uint8_t)(*flags | rdpi_controller_flags(model));
    rdpi_controller_acknowledge(model, command_V);
    return command_V;
}

/* One of the flags by the place of its variable; false where there is none. */
static bool rdpi_fmu_flag(uint8_t flags, uint32_t place, bool *value)
{
    static const uint8_t bits[3] = {RDPI_CLAMPED, RDPI_SATURATED, RDPI_OUT_OF_RANGE};
    if (place >= 3u) {
        return false;
    }
    *value = (flags & bits[place]) != 0u;
    return true;
}

#endif
