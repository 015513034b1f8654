/* speed ROUNDS: nanoseconds of the processor for a step with its acknowledgement, a line a round. */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "rdpi_controller.h"
#include "rdpi_vectors.h"

#define REPEATED 50

static rdpi_controller_state state;
static rdpi_real reference[RDPI_VECTORS + RDPI_CONTROLLER_PREVIEW];
static rdpi_real measured[RDPI_VECTORS];
static volatile rdpi_real seen;

static double now_ns(void)
{
    struct timespec now;

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return 1e9 * (double)now.tv_sec + (double)now.tv_nsec;
}

int main(int count, char **words)
{
    const rdpi_controller_parameters *p = &rdpi_controller_default;
    const int rounds = (count > 1) ? atoi(words[1]) : 1;

    for (int k = 0; k < RDPI_VECTORS + RDPI_CONTROLLER_PREVIEW; ++k) {
        reference[k] = rdpi_controller_from_um((double)rdpi_vector_reference_um[k]);
    }
    for (int k = 0; k < RDPI_VECTORS; ++k) {
        measured[k] = rdpi_controller_from_um((double)rdpi_vector_measured_um[k]);
    }
    rdpi_controller_init(&state, p, reference[0]);
    for (int round = 0; round < rounds; ++round) {
        const double begin = now_ns();

        for (int again = 0; again < REPEATED; ++again) {
            for (int k = 0; k < RDPI_VECTORS; ++k) {
                const rdpi_real command =
                    rdpi_controller_step(&state, p, reference[k], &reference[k + 1], measured[k]);

                rdpi_controller_acknowledge(&state, command);
                seen = command;
            }
        }
        printf("%.3f\n", (now_ns() - begin) / REPEATED / RDPI_VECTORS);
    }
    return 0;
}
