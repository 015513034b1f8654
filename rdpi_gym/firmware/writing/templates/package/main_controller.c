/* Runs the @SAMPLES@ vectors and compares with what Python made of them; 0 where all is well. */
#include <stdio.h>

#include "@NAME@.h"

#include "rdpi_vectors.h"

#if RDPI_PRECISION == 64
#define RDPI_ALLOWED @ALLOWED_DOUBLE@
#elif RDPI_PRECISION == 32
#define RDPI_ALLOWED @ALLOWED_FLOAT@
#else
#define RDPI_ALLOWED @ALLOWED_WHOLE@
#endif

static rdpi_controller_state state;
static rdpi_real ahead[RDPI_CONTROLLER_PREVIEW];

int main(void)
{
    const rdpi_controller_parameters *p = &rdpi_controller_default;
    const double range =
        rdpi_controller_to_V(RDPI_CONTROLLER_HIGH_V) - rdpi_controller_to_V(RDPI_CONTROLLER_LOW_V);
    double largest = 0.0;
    int32_t wrong = 0;

    rdpi_controller_init(&state, p, rdpi_controller_from_um((double)rdpi_vector_reference_um[0]));
    for (int32_t k = 0; k < RDPI_VECTORS; ++k) {
        const rdpi_real reference = rdpi_controller_from_um((double)rdpi_vector_reference_um[k]);
        const rdpi_real measured = rdpi_controller_from_um((double)rdpi_vector_measured_um[k]);
        rdpi_real command;
        double difference;

        for (int32_t i = 0; i < RDPI_CONTROLLER_PREVIEW; ++i) {
            ahead[i] = rdpi_controller_from_um((double)rdpi_vector_reference_um[k + 1 + i]);
        }
        command = rdpi_controller_step(&state, p, reference, ahead, measured);
        rdpi_controller_acknowledge(&state, command);
        difference = (rdpi_controller_to_V(command) - (double)rdpi_vector_expected_V[k]) / range;
        difference = difference < 0.0 ? -difference : difference;
        if (!(difference <= RDPI_ALLOWED)) {
            wrong = 1;
        }
        if (difference > largest) {
            largest = difference;
        }
    }
    printf("%d vectors: largest difference %.2g of the range (allowed %.2g)\n", RDPI_VECTORS, largest, RDPI_ALLOWED);
    return wrong ? 1 : 0;
}
