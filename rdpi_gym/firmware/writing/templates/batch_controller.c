/* batch IN OUT LANES SAMPLES WILD: every lane from rest; doubles in, doubles out. */
#include <stdio.h>
#include <stdlib.h>

#include "rdpi_controller.h"

static rdpi_controller_state state;
static rdpi_real ahead[RDPI_CONTROLLER_PREVIEW];

int main(int count, char **words)
{
    const rdpi_controller_parameters *p = &rdpi_controller_default;
    FILE *in;
    FILE *out;
    long lanes;
    long samples;
    int wild;
    double *reference;
    double *measured;

    if (count != 6) {
        return 2;
    }
    in = fopen(words[1], "rb");
    out = fopen(words[2], "wb");
    lanes = atol(words[3]);
    samples = atol(words[4]);
    wild = atoi(words[5]);
    reference = malloc((size_t)(samples + RDPI_CONTROLLER_PREVIEW) * sizeof *reference);
    measured = malloc((size_t)samples * sizeof *measured);
    if (!in || !out || !reference || !measured) {
        return 3;
    }
    for (long lane = 0; lane < lanes; ++lane) {
        size_t read = fread(reference, sizeof *reference, (size_t)(samples + RDPI_CONTROLLER_PREVIEW), in);
        read += fread(measured, sizeof *measured, (size_t)samples, in);
        if (read != (size_t)(2 * samples + RDPI_CONTROLLER_PREVIEW)) {
            return 4;
        }
        rdpi_controller_init(&state, p, rdpi_controller_from_um(reference[0]));
        for (long k = 0; k < samples; ++k) {
            rdpi_real command;
            double written;

            for (long i = 0; i < RDPI_CONTROLLER_PREVIEW; ++i) {
                ahead[i] = rdpi_controller_from_um(reference[k + 1 + i]);
            }
            command = rdpi_controller_step(&state, p, rdpi_controller_from_um(reference[k]), ahead,
                                           rdpi_controller_from_um(measured[k]));
            if (!wild || k % 5 > 1) {
                rdpi_controller_acknowledge(&state, command);
            } else if (k % 5 == 1) {
                rdpi_controller_acknowledge(&state, rdpi_controller_from_V(measured[k]));
            }
            written = rdpi_controller_to_V(command);
            if (fwrite(&written, sizeof written, 1, out) != 1) {
                return 5;
            }
        }
    }
    free(reference);
    free(measured);
    fclose(in);
    return fclose(out) ? 6 : 0;
}
