/* A loop on a desktop: a triangle in, commands out, and how long a step takes. */
#include <stdio.h>
#include <time.h>

#include "@NAME@.h"

#define STEPS 1000000

static rdpi_controller_state state;
static rdpi_real reference[1 + RDPI_CONTROLLER_PREVIEW];

/* A triangle of a third of the usual amplitude, 2000 samples long. */
static double triangle(long k)
{
    const double place = (double)(k % 2000) / 2000.0;
    const double size = place < 0.5 ? 4.0 * place - 1.0 : 3.0 - 4.0 * place;

    return @CENTRE@ + @THIRD@ * size;
}

int main(void)
{
    const rdpi_controller_parameters *p = &rdpi_controller_default;
    double sum = 0.0;
    clock_t begun;
    double nanoseconds;

    rdpi_controller_init(&state, p, rdpi_controller_from_um(triangle(0)));
    for (long i = 0; i <= RDPI_CONTROLLER_PREVIEW; ++i) {
        reference[i] = rdpi_controller_from_um(triangle(i));
    }
    begun = clock();
    for (long k = 0; k < STEPS; ++k) {
        /* here a sensor would be read; this stage stands where it should */
        const rdpi_real measured = reference[0];
        const rdpi_real command = rdpi_controller_step(&state, p, reference[0], &reference[1], measured);

        /* here the command would be written */
        rdpi_controller_acknowledge(&state, command);
        sum += rdpi_controller_to_V(command);
        for (long i = 0; i < RDPI_CONTROLLER_PREVIEW; ++i) {
            reference[i] = reference[i + 1];
        }
        reference[RDPI_CONTROLLER_PREVIEW] = rdpi_controller_from_um(triangle(k + 1 + RDPI_CONTROLLER_PREVIEW));
    }
    nanoseconds = 1e9 * (double)(clock() - begun) / (double)CLOCKS_PER_SEC / STEPS;
    printf("mean command %.3f V, %.0f ns a step\n", sum / STEPS, nanoseconds);
    return 0;
}
