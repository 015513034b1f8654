/* A loop on a desktop: a triangle of commands in, displacements out, and how long a step takes. */
#include <stdio.h>
#include <time.h>

#include "@NAME@.h"

#define STEPS 1000000

static rdpi_plant_state state;

int main(void)
{
    const rdpi_plant_parameters *p = &rdpi_plant_default;
    const double low = rdpi_plant_to_V(RDPI_PLANT_LOW_V);
    const double high = rdpi_plant_to_V(RDPI_PLANT_HIGH_V);
    double sum = 0.0;
    clock_t begun;
    double nanoseconds;

    rdpi_plant_init(&state, p);
    begun = clock();
    for (long k = 0; k < STEPS; ++k) {
        const double place = (double)(k % 2000) / 2000.0;
        const double share = place < 0.5 ? 2.0 * place : 2.0 - 2.0 * place;

        sum += rdpi_plant_to_um(rdpi_plant_step(&state, p, rdpi_plant_from_V(low + share * (high - low))));
    }
    nanoseconds = 1e9 * (double)(clock() - begun) / (double)CLOCKS_PER_SEC / STEPS;
    printf("mean displacement %.3f um, %.0f ns a step\n", sum / STEPS, nanoseconds);
    return 0;
}
