/* Runs the @SAMPLES@ vectors and compares with what Python made of them; 0 where all is well. */
#include <stdio.h>

#include "@NAME@.h"

#include "rdpi_vectors.h"

#if RDPI_PRECISION == 64
#define RDPI_ALLOWED @ALLOWED_DOUBLE@
#else
#define RDPI_ALLOWED @ALLOWED_FLOAT@
#endif

static rdpi_plant_state state;

int main(void)
{
    const rdpi_plant_parameters *p = &rdpi_plant_default;
    double lowest = (double)rdpi_vector_expected_um[0];
    double highest = lowest;
    double largest = 0.0;
    double stroke;
    int32_t wrong = 0;

    rdpi_plant_init(&state, p);
    for (int32_t k = 0; k < RDPI_VECTORS; ++k) {
        const double expected = (double)rdpi_vector_expected_um[k];
        const rdpi_real command = rdpi_plant_from_V((double)rdpi_vector_command_V[k]);
        double difference = rdpi_plant_to_um(rdpi_plant_step(&state, p, command)) - expected;

        difference = difference < 0.0 ? -difference : difference;
        lowest = expected < lowest ? expected : lowest;
        highest = expected > highest ? expected : highest;
        if (!(difference <= 1e300)) {
            wrong = 1;
        }
        if (difference > largest) {
            largest = difference;
        }
    }
    stroke = highest > lowest ? highest - lowest : 1.0;
    if (largest > RDPI_ALLOWED * stroke) {
        wrong = 1;
    }
    printf("%d vectors: largest difference %.2g of the stroke (allowed %.2g)\n", RDPI_VECTORS, largest / stroke,
           RDPI_ALLOWED);
    return wrong ? 1 : 0;
}
