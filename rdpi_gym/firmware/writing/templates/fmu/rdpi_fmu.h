/* One instance of the model behind the functional mock-up interface: what FMI 2.0 and 3.0 share.
 *
 * A communication step of n sampling times runs n samples with the inputs that stand at its
 * beginning; the output that stands afterwards is that of the last of them. Nothing is global, and
 * nothing is allocated but an instance and copies of its memory. */
#ifndef RDPI_FMU_H
#define RDPI_FMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "rdpi_fmu_model.h"

#if RDPI_PRECISION != 64
#error "an FMU is built in double precision: leave RDPI_PRECISION at 64"
#endif

/* Value references, as modelDescription.xml has them; inputs follow RDPI_FMU_FIRST_INPUT. */
#define RDPI_FMU_TIME 0u
#define RDPI_FMU_SAMPLING_TIME 1u
#define RDPI_FMU_OUTPUT 2u
#define RDPI_FMU_FIRST_FLAG 3u /* clamped; of a controller saturated; out of range */
#define RDPI_FMU_FIRST_INPUT 10u

#define RDPI_FMU_MESSAGE 200 /* characters of a message, its end included */

typedef enum {
    RDPI_FMU_INSTANTIATED,
    RDPI_FMU_INITIALIZING,
    RDPI_FMU_STEPPING,
    RDPI_FMU_TERMINATED
} rdpi_fmu_mode;

/* All that a copy of an instance holds. */
typedef struct {
    rdpi_fmu_model model;
    double input[RDPI_FMU_INPUTS];
    double output;
    double time_s;
    uint8_t flags; /* of any sample of the last step */
    uint8_t begun; /* whether the first sample is done */
    uint8_t mode;  /* an rdpi_fmu_mode */
} rdpi_fmu_memory;

/* A copy of the memory as bytes begins with the token of the model that it fits. */
#define RDPI_FMU_BYTES (sizeof(RDPI_FMU_TOKEN) + sizeof(rdpi_fmu_memory))

static double rdpi_fmu_distance(double a, double b)
{
    return a < b ? b - a : a - b;
}

/* At rest, as after instantiation; what it returns before its first sample depends on no input. */
static void rdpi_fmu_reset(rdpi_fmu_memory *memory)
{
    size_t i;
    memset(memory, 0, sizeof *memory);
    for (i = 0; i < RDPI_FMU_INPUTS; i++) {
        memory->input[i] = RDPI_FMU_START;
    }
    memory->output = rdpi_fmu_rest(&memory->model);
    memory->mode = (uint8_t)RDPI_FMU_INSTANTIATED;
}

static bool rdpi_fmu_get(const rdpi_fmu_memory *memory, uint32_t reference, double *value)
{
    if (reference == RDPI_FMU_TIME) {
        *value = memory->time_s;
    } else if (reference == RDPI_FMU_SAMPLING_TIME) {
        *value = RDPI_FMU_TS_S;
    } else if (reference == RDPI_FMU_OUTPUT) {
        *value = memory->output;
    } else if (reference >= RDPI_FMU_FIRST_INPUT
               && reference - RDPI_FMU_FIRST_INPUT < RDPI_FMU_INPUTS) {
        *value = memory->input[reference - RDPI_FMU_FIRST_INPUT];
    } else {
        return false;
    }
    return true;
}

static bool rdpi_fmu_set(rdpi_fmu_memory *memory, uint32_t reference, double value)
{
    if (reference < RDPI_FMU_FIRST_INPUT || reference - RDPI_FMU_FIRST_INPUT >= RDPI_FMU_INPUTS
        || memory->mode == (uint8_t)RDPI_FMU_TERMINATED) {
        return false;
    }
    memory->input[reference - RDPI_FMU_FIRST_INPUT] = value;
    return true;
}

static bool rdpi_fmu_is(const rdpi_fmu_memory *memory, rdpi_fmu_mode mode, char *message)
{
    if (memory->mode != (uint8_t)mode) {
        (void)snprintf(message, RDPI_FMU_MESSAGE, "is not allowed in this state of the FMU");
        return false;
    }
    return true;
}

static bool rdpi_fmu_begin(rdpi_fmu_memory *memory, double start_s, char *message)
{
    if (rdpi_fmu_distance(start_s, start_s) != 0.0) {
        (void)snprintf(message, RDPI_FMU_MESSAGE, "start time %g is not finite", start_s);
        return false;
    }
    memory->time_s = start_s;
    return true;
}

/* Run the samples of one communication step, or none and say why not. */
static bool rdpi_fmu_run(rdpi_fmu_memory *memory, double now_s, double step_s, char *message)
{
    /* an importer's times are rounded */
    const double rounding_s
        = 1e-6 * RDPI_FMU_TS_S + 2e-15 * rdpi_fmu_distance(memory->time_s, -step_s);
    double samples = step_s / RDPI_FMU_TS_S;
    uint64_t left;

    if (!rdpi_fmu_is(memory, RDPI_FMU_STEPPING, message)) {
        return false;
    }
    left = samples > 0.5 && samples < 1e15 ? (uint64_t)(samples + 0.5) : 0u;
    samples = (double)left;
    if (left == 0u || !(rdpi_fmu_distance(step_s, samples * RDPI_FMU_TS_S) <= rounding_s)) {
        (void)snprintf(message, RDPI_FMU_MESSAGE,
                       "cannot step by %.12g s; give a whole multiple of the sampling time, %.12g s",
                       step_s, RDPI_FMU_TS_S);
        return false;
    }
    if (!(rdpi_fmu_distance(now_s, memory->time_s) <= 1e-3 * RDPI_FMU_TS_S + rounding_s)) {
        (void)snprintf(message, RDPI_FMU_MESSAGE,
                       "begins at %.12g s, but the last communication step ended at %.12g s", now_s,
                       memory->time_s);
        return false;
    }
    for (memory->flags = 0u; left > 0u; left--) {
        if (memory->begun == 0u) {
            rdpi_fmu_first(&memory->model, memory->input);
            memory->begun = 1u;
        }
        memory->output = rdpi_fmu_sample(&memory->model, memory->input, &memory->flags);
    }
    memory->time_s = now_s + step_s;
    return true;
}

static void rdpi_fmu_write(const rdpi_fmu_memory *memory, void *bytes)
{
    memcpy(bytes, RDPI_FMU_TOKEN, sizeof(RDPI_FMU_TOKEN));
    memcpy((char *)bytes + sizeof(RDPI_FMU_TOKEN), memory, sizeof *memory);
}

/* Copy the memory into *copy, which is allocated where it is NULL. */
static bool rdpi_fmu_keep(const void *memory, void **copy, char *message)
{
    if (*copy == NULL) {
        *copy = malloc(sizeof(rdpi_fmu_memory));
    }
    if (*copy == NULL) {
        (void)snprintf(message, RDPI_FMU_MESSAGE, "no memory is left");
        return false;
    }
    memcpy(*copy, memory, sizeof(rdpi_fmu_memory));
    return true;
}

static bool rdpi_fmu_read(const void *bytes, size_t size, void **copy, char *message)
{
    if (bytes == NULL || size != RDPI_FMU_BYTES
        || memcmp(bytes, RDPI_FMU_TOKEN, sizeof(RDPI_FMU_TOKEN)) != 0) {
        (void)snprintf(message, RDPI_FMU_MESSAGE, "these bytes are no state of this model");
        return false;
    }
    *copy = NULL;
    return rdpi_fmu_keep((const char *)bytes + sizeof(RDPI_FMU_TOKEN), copy, message);
}

#endif
